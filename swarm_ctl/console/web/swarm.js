import { THREE } from "nicegui-scene";
import { look } from "./phases.js";

const TRAIL = 80; // points, as in picture.py
const SYMBOL = 0.0075; // of the distance to the camera
const MOST = 256;
const GROUND = new THREE.Color("#1a2a33");
const PATH = new THREE.Color("#b9d2e4");
const CHOSEN = new THREE.Color("#ffffff");

// The vehicles with headings and heights, their trails, and who hears whom.
export class Swarm {
  constructor(scene) {
    this.vehicles = new Map();
    this.selected = null;
    this.rim = darts("#05080b", 0);
    this.body = darts("#ffffff", 1);
    this.stems = segments(2 * MOST, "#7f95a8", 0.45);
    this.links = segments(16384, "#7fb2ff", 0.5);
    this.chosen = segments(2 * MOST, "#ffffff", 0.75);
    this.trails = segments(2 * MOST * TRAIL, null, 1);
    scene.add(this.trails, this.links, this.chosen, this.stems, this.rim, this.body);
  }

  clear() {
    this.vehicles.clear();
  }

  // Take new rows; places are reached within `since` milliseconds.
  show(rows, now, since) {
    for (const row of rows) {
      const known = this.vehicles.get(row.sysid) ?? { trail: [] };
      known.trail.push(...row.trail);
      known.trail.splice(0, known.trail.length - TRAIL);
      const from = known.at ?? row.place;
      const yawFrom = known.yawAt ?? row.yaw;
      const turn = Math.atan2(Math.sin(row.yaw - yawFrom), Math.cos(row.yaw - yawFrom));
      Object.assign(known, { row, from, to: row.place, yawFrom, yawTo: yawFrom + turn });
      this.vehicles.set(row.sysid, known);
    }
    [this.began, this.lasts] = [now, since];
  }

  // Move everybody to where it is now; true while somebody is still on the way.
  draw(now, camera, target) {
    const share = this.lasts ? Math.min(1, (now - this.began) / this.lasts) : 1;
    const size = SYMBOL * camera.position.distanceTo(target);
    let count = 0;
    const stems = [];
    for (const one of this.vehicles.values()) {
      one.at = one.to && one.from ? one.from.map((v, i) => v + share * (one.to[i] - v)) : one.to;
      one.yawAt = one.yawFrom + share * (one.yawTo - one.yawFrom);
      if (!one.at || count >= MOST) continue;
      const [north, east, down] = one.at;
      const scale = one.row.sysid === this.selected ? 1.35 * size : size;
      place(this.rim, count, east, north, -down, one.yawAt, 1.4 * scale);
      place(this.body, count, east, north, -down + 0.02 * size, one.yawAt, scale);
      this.body.setColorAt(count, new THREE.Color(look(one.row.phase)[1]));
      stems.push(east, north, 0.03, east, north, -down);
      count += 1;
    }
    for (const mesh of [this.rim, this.body]) {
      mesh.count = count;
      mesh.instanceMatrix.needsUpdate = true;
    }
    if (this.body.instanceColor) this.body.instanceColor.needsUpdate = true;
    fill(this.stems, stems);
    this.drawLinks();
    this.drawTrails();
    return share < 1;
  }

  drawLinks() {
    const [all, chosen] = [[], []];
    for (const one of this.vehicles.values()) {
      for (const peer of one.row.peers) {
        const other = this.vehicles.get(peer);
        const isDouble = other?.row.peers.includes(one.row.sysid) && peer < one.row.sysid;
        if (!one.at || !other?.at || isDouble) continue;
        const isChosen = one.row.sysid === this.selected || peer === this.selected;
        (isChosen ? chosen : all).push(...point(one.at), ...point(other.at));
      }
    }
    fill(this.links, all);
    fill(this.chosen, chosen);
  }

  drawTrails() {
    const [points, colours] = [[], []];
    for (const one of this.vehicles.values()) {
      const bright = one.row.sysid === this.selected ? CHOSEN : PATH;
      const path = one.at ? [...one.trail, one.at] : one.trail;
      for (let i = 1; i < path.length; i += 1) {
        points.push(...point(path[i - 1]), ...point(path[i]));
        colours.push(...fading(bright, (i - 1) / path.length), ...fading(bright, i / path.length));
      }
    }
    fill(this.trails, points, colours);
  }
}

const point = ([north, east, down]) => [east, north, -down];

const fading = (bright, share) => GROUND.clone().lerp(bright, 0.15 + 0.7 * share).toArray();

function place(mesh, index, x, y, z, yaw, scale) {
  const turn = new THREE.Quaternion().setFromAxisAngle(new THREE.Vector3(0, 0, 1), -yaw);
  const size = new THREE.Vector3(scale, scale, scale);
  mesh.setMatrixAt(index, new THREE.Matrix4().compose(new THREE.Vector3(x, y, z), turn, size));
}

function darts(color, order) {
  const outline = [[0, 1], [0.75, -0.8], [0, -0.4], [-0.75, -0.8]];
  const shape = new THREE.Shape(outline.map(([x, y]) => new THREE.Vector2(x, y)));
  const material = new THREE.MeshBasicMaterial({ color, side: THREE.DoubleSide, depthTest: false });
  material.transparent = true; // so that it is drawn after the walls
  const mesh = new THREE.InstancedMesh(new THREE.ShapeGeometry(shape), material, MOST);
  mesh.frustumCulled = false;
  mesh.renderOrder = 10 + order;
  mesh.count = 0;
  return mesh;
}

function segments(most, color, opacity) {
  const geometry = new THREE.BufferGeometry();
  const room = () => new THREE.BufferAttribute(new Float32Array(3 * most), 3);
  geometry.setAttribute("position", room().setUsage(THREE.DynamicDrawUsage));
  if (!color) geometry.setAttribute("color", room().setUsage(THREE.DynamicDrawUsage));
  const look = color ? { color } : { vertexColors: true };
  const material = new THREE.LineBasicMaterial({ ...look, opacity, transparent: true });
  const mesh = new THREE.LineSegments(geometry, material);
  mesh.frustumCulled = false;
  return mesh;
}

function fill({ geometry }, points, colours = []) {
  const { position, color } = geometry.attributes;
  const most = Math.min(points.length, position.array.length);
  position.array.set(most < points.length ? points.slice(0, most) : points);
  position.needsUpdate = true;
  if (color) {
    color.array.set(most < colours.length ? colours.slice(0, most) : colours);
    color.needsUpdate = true;
  }
  geometry.setDrawRange(0, most / 3);
}
