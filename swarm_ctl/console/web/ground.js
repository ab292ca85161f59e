import { THREE } from "nicegui-scene";

const FLOOR = "#111a22";
const GRID = "#1c2934";
const WALL = "#6f8aa3";
const EDGE = "#9db4c8";

// Give west, south, east, north and top of a world; of none, what surrounds a few vehicles.
export function boundsOf(world, places = []) {
  if (world?.low && world?.high) {
    return [world.low[1], world.low[0], world.high[1], world.high[0], -world.low[2]];
  }
  const [easts, norths] = [places.map((p) => p[1]), places.map((p) => p[0])];
  const reach = (values) => [Math.min(...values, -5) - 5, Math.max(...values, 5) + 5];
  const [[west, east], [south, north]] = [reach(easts), reach(norths)];
  return [west, south, east, north, 3];
}

// Build floor, grid and the floor plan's walls.
export function buildGround(world, [west, south, east, north], step) {
  const group = new THREE.Group();
  const [wide, deep] = [east - west, north - south];
  const floor = new THREE.Mesh(
    new THREE.PlaneGeometry(wide, deep), new THREE.MeshBasicMaterial({ color: FLOOR }),
  );
  floor.position.set(west + wide / 2, south + deep / 2, 0);
  group.add(floor, lines(gridPoints(west, south, east, north, step), GRID, 1));
  const polygons = world?.polygons ?? [];
  if (polygons.length) group.add(...walls(polygons));
  if (world?.closed) group.add(lines(boxPoints(west, south, east, north, -world.low[2]), EDGE, 0.35));
  return group;
}

export function gridStep(wide, deep) {
  return [1, 2, 5, 10, 20, 50, 100, 200, 500].find((m) => Math.max(wide, deep) / m <= 12) ?? 1000;
}

function gridPoints(west, south, east, north, step) {
  const points = [];
  for (let x = Math.ceil(west / step) * step; x <= east; x += step) {
    points.push(x, south, 0.01, x, north, 0.01);
  }
  for (let y = Math.ceil(south / step) * step; y <= north; y += step) {
    points.push(west, y, 0.01, east, y, 0.01);
  }
  return points;
}

// What encloses a closed world: its corners and its upper and lower edges.
function boxPoints(west, south, east, north, top) {
  const corners = [[west, south], [east, south], [east, north], [west, north]];
  return corners.flatMap(([x, y], i) => {
    const [u, v] = corners[(i + 1) % 4];
    return [x, y, 0, u, v, 0, x, y, top, u, v, top, x, y, 0, x, y, top];
  });
}

export function lines(points, color, opacity) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
  const material = new THREE.LineBasicMaterial({ color, opacity, transparent: opacity < 1 });
  return new THREE.LineSegments(geometry, material);
}

// Join all solids into one mesh and all their edges into one set of lines: two draws, not hundreds.
function walls(polygons) {
  const faces = [];
  const edges = [];
  for (const { points_ne_m: points, bottom_m: bottom, top_m: top } of polygons) {
    const corners = points.map(([north, east]) => new THREE.Vector2(east, north));
    if (THREE.ShapeUtils.isClockWise(corners)) corners.reverse();
    for (const triangle of THREE.ShapeUtils.triangulateShape(corners, [])) {
      for (const index of triangle) faces.push(corners[index].x, corners[index].y, top);
    }
    corners.forEach((a, index) => {
      const b = corners[(index + 1) % corners.length];
      faces.push(a.x, a.y, bottom, b.x, b.y, bottom, b.x, b.y, top);
      faces.push(a.x, a.y, bottom, b.x, b.y, top, a.x, a.y, top);
      edges.push(a.x, a.y, top, b.x, b.y, top);
      if (bottom < 0.01) edges.push(a.x, a.y, 0.02, b.x, b.y, 0.02);
    });
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(faces, 3));
  const material = new THREE.MeshBasicMaterial({
    color: WALL, transparent: true, opacity: 0.15, depthWrite: false, side: THREE.DoubleSide,
  });
  return [new THREE.Mesh(geometry, material), lines(edges, EDGE, 0.5)];
}
