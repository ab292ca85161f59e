"""The message schemas of Foxglove that exports use, as JSON Schema, written down in short.

The field names and numbers are Foxglove's (docs.foxglove.dev, "Message schemas"); viewers know a
schema by its name.
"""

from __future__ import annotations

from typing import Any

Schema = dict[str, Any]

NUMBER: Schema = {"type": "number"}
WHOLE: Schema = {"type": "integer", "minimum": 0}
TEXT: Schema = {"type": "string"}
FLAG: Schema = {"type": "boolean"}
BYTES: Schema = {"type": "string", "contentEncoding": "base64"}


def _object(title: str, **fields: Schema) -> Schema:
    return {"title": title, "type": "object", "properties": fields}


def _list(items: Schema) -> Schema:
    return {"type": "array", "items": items}


def _moment(title: str) -> Schema:
    nanoseconds = {**WHOLE, "maximum": 999_999_999}
    return _object(title, sec={"type": "integer"}, nsec=nanoseconds)


TIME, DURATION = _moment("time"), _moment("duration")
VECTOR2 = _object("foxglove.Vector2", x=NUMBER, y=NUMBER)
VECTOR3 = _object("foxglove.Vector3", x=NUMBER, y=NUMBER, z=NUMBER)
POINT3 = _object("foxglove.Point3", x=NUMBER, y=NUMBER, z=NUMBER)
QUATERNION = _object("foxglove.Quaternion", x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
POSE = _object("foxglove.Pose", position=VECTOR3, orientation=QUATERNION)
COLOUR = _object("foxglove.Color", r=NUMBER, g=NUMBER, b=NUMBER, a=NUMBER)
PAIR = _object("foxglove.KeyValuePair", key=TEXT, value=TEXT)
FIELD = _object("foxglove.PackedElementField", name=TEXT, offset=WHOLE, type=WHOLE)

_SOLID = {"pose": POSE, "size": VECTOR3, "color": COLOUR}
ENTITY = _object(
    "foxglove.SceneEntity",
    timestamp=TIME,
    frame_id=TEXT,
    id=TEXT,
    lifetime=DURATION,
    frame_locked=FLAG,
    metadata=_list(PAIR),
    arrows=_list(
        _object(
            "foxglove.ArrowPrimitive",
            pose=POSE,
            shaft_length=NUMBER,
            shaft_diameter=NUMBER,
            head_length=NUMBER,
            head_diameter=NUMBER,
            color=COLOUR,
        )
    ),
    cubes=_list(_object("foxglove.CubePrimitive", **_SOLID)),
    spheres=_list(_object("foxglove.SpherePrimitive", **_SOLID)),
    cylinders=_list(
        _object("foxglove.CylinderPrimitive", **_SOLID, bottom_scale=NUMBER, top_scale=NUMBER)
    ),
    lines=_list(
        _object(
            "foxglove.LinePrimitive",
            type=WHOLE,
            pose=POSE,
            thickness=NUMBER,
            scale_invariant=FLAG,
            points=_list(POINT3),
            color=COLOUR,
            colors=_list(COLOUR),
            indices=_list(WHOLE),
        )
    ),
    triangles=_list(
        _object(
            "foxglove.TriangleListPrimitive",
            pose=POSE,
            points=_list(POINT3),
            color=COLOUR,
            colors=_list(COLOUR),
            indices=_list(WHOLE),
        )
    ),
    texts=_list(
        _object(
            "foxglove.TextPrimitive",
            pose=POSE,
            billboard=FLAG,
            font_size=NUMBER,
            scale_invariant=FLAG,
            color=COLOUR,
            text=TEXT,
        )
    ),
    models=_list(
        _object(
            "foxglove.ModelPrimitive",
            pose=POSE,
            scale=VECTOR3,
            color=COLOUR,
            override_color=FLAG,
            url=TEXT,
            media_type=TEXT,
            data=BYTES,
        )
    ),
)

SCHEMAS: dict[str, Schema] = {
    schema["title"]: schema
    for schema in (
        _object(
            "foxglove.SceneUpdate",
            deletions=_list(
                _object("foxglove.SceneEntityDeletion", timestamp=TIME, type=WHOLE, id=TEXT)
            ),
            entities=_list(ENTITY),
        ),
        _object(
            "foxglove.FrameTransforms",
            transforms=_list(
                _object(
                    "foxglove.FrameTransform",
                    timestamp=TIME,
                    parent_frame_id=TEXT,
                    child_frame_id=TEXT,
                    translation=VECTOR3,
                    rotation=QUATERNION,
                )
            ),
        ),
        _object(
            "foxglove.Log",
            timestamp=TIME,
            level=WHOLE,
            message=TEXT,
            name=TEXT,
            file=TEXT,
            line=WHOLE,
        ),
        _object(
            "foxglove.LocationFix",
            timestamp=TIME,
            frame_id=TEXT,
            latitude=NUMBER,
            longitude=NUMBER,
            altitude=NUMBER,
            position_covariance={**_list(NUMBER), "minItems": 9, "maxItems": 9},
            position_covariance_type=WHOLE,
        ),
        _object(
            "foxglove.Grid",
            timestamp=TIME,
            frame_id=TEXT,
            pose=POSE,
            column_count=WHOLE,
            cell_size=VECTOR2,
            row_stride=WHOLE,
            cell_stride=WHOLE,
            fields=_list(FIELD),
            data=BYTES,
        ),
        _object("foxglove.GeoJSON", geojson=TEXT),
        _object(
            "swarm_ctl.Swarm",
            timestamp=TIME,
            explored_fraction=NUMBER,
            victims_found=WHOLE,
            pairs_in_contact=WHOLE,
            groups=WHOLE,
        ),
        _object("swarm_ctl.Battery", timestamp=TIME, left_fraction=NUMBER, power_w=NUMBER),
    )
}
"""By name; the two of our own are for plots."""
