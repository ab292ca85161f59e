import { THREE } from "nicegui-scene";
import { look } from "./phases.js";
import { Segments } from "./segments.js";

const TRAIL = 80; // points, as in picture.py
const SYMBOL = 0.0075; // of the distance to the camera
const MOST = 256; // vehicles
const SHADES = 16;
const [GROUND, PATH, CHOSEN] = ["#1a2a33", "#b9d2e4", "#ffffff"].map((c) => new THREE.Color(c));
const FADING = shades(PATH);
const FADING_CHOSEN = shades(CHOSEN);
const COLORS = new Map();

// The vehicles with headings and heights, their trails, and who hears whom.
export class Swarm {
  constructor(scene) {
    this.vehicles = new Map();
    this.selected = null;
    this.trails = new Segments(scene, MOST * TRAIL, null);
    this.tips = new Segments(scene, MOST, null);
    this.links = new Segments(scene, 8192, "#7fb2ff", 0.5);
    this.chosen = new Segments(scene, MOST, "#ffffff", 0.8);
    this.stems = new Segments(scene, MOST, "#7f95a8", 0.45);
    this.rim = darts("#05080b", 0);
    this.body = darts("#ffffff", 1);
    scene.add(this.rim, this.body);
  }

  clear() {
    this.vehicles.clear();
  }

  // Take new rows; their places are reached within `since` milliseconds.
  show(rows, now, since) {
    for (const row of rows) {
      const known = this.vehicles.get(row.sysid) ?? { trail: [] };
      known.trail.push(...row.trail);
      known.trail.splice(0, known.trail.length - TRAIL);
      const from = known.at ?? row.place;
      const yawFrom = known.yawAt ?? row.yaw;
      const turn = Math.atan2(Math.sin(row.yaw - yawFrom), Math.cos(row.yaw - yawFrom));
      Object.assign(known, { row, from, to: row.place, yawFrom, turn });
      this.vehicles.set(row.sysid, known);
    }
    [this.began, this.lasts] = [now, since];
    this.drawTrails();
  }

  select(sysid) {
    this.selected = sysid;
    this.drawTrails();
  }

  // Move everybody to where it is now; true while somebody is still on the way.
  draw(now, camera, target) {
    const share = this.lasts ? Math.min(1, (now - this.began) / this.lasts) : 1;
    const size = SYMBOL * camera.position.distanceTo(target);
    let count = 0;
    this.stems.clear();
    for (const one of this.vehicles.values()) {
      one.at = one.to && one.from ? one.from.map((v, i) => v + share * (one.to[i] - v)) : one.to;
      one.yawAt = one.yawFrom + share * one.turn;
      if (!one.at || count >= MOST) continue;
      const scale = one.row.sysid === this.selected ? 1.35 * size : size;
      place(this.rim, count, one, 0, 1.4 * scale);
      place(this.body, count, one, 0.02 * size, scale);
      this.body.setColorAt(count, color(one.row.phase));
      this.stems.add([one.at[0], one.at[1], -0.03], one.at);
      count += 1;
    }
    for (const mesh of [this.rim, this.body]) {
      mesh.count = count;
      mesh.instanceMatrix.needsUpdate = true;
    }
    if (this.body.instanceColor) this.body.instanceColor.needsUpdate = true;
    this.stems.show();
    this.drawLinks();
    this.drawTips();
    return share < 1;
  }

  drawLinks() {
    this.links.clear();
    this.chosen.clear();
    for (const { row, at } of this.vehicles.values()) {
      for (const peer of row.peers) {
        const other = this.vehicles.get(peer);
        const isDrawn = peer < row.sysid && other?.row.peers.includes(row.sysid);
        if (!at || !other?.at || isDrawn) continue;
        const isChosen = row.sysid === this.selected || peer === this.selected;
        (isChosen ? this.chosen : this.links).add(at, other.at);
      }
    }
    this.links.show();
    this.chosen.show();
  }

  // The older, the darker; what is between the last point and the vehicle changes with every picture.
  drawTrails() {
    this.trails.clear();
    for (const { row, trail } of this.vehicles.values()) {
      const fading = row.sysid === this.selected ? FADING_CHOSEN : FADING;
      for (let i = 1; i < trail.length; i += 1) {
        const shade = fading[Math.floor((SHADES * i) / trail.length)];
        this.trails.add(trail[i - 1], trail[i], shade, shade);
      }
    }
    this.trails.show();
  }

  drawTips() {
    this.tips.clear();
    for (const { row, at, trail } of this.vehicles.values()) {
      const bright = row.sysid === this.selected ? CHOSEN : PATH;
      if (at && trail.length) this.tips.add(trail[trail.length - 1], at, bright, bright);
    }
    this.tips.show();
  }
}

function shades(bright) {
  const shade = (_, i) => GROUND.clone().lerp(bright, 0.15 + (0.85 * (i + 1)) / SHADES);
  return Array.from({ length: SHADES }, shade);
}

function color(phase) {
  if (!COLORS.has(phase)) COLORS.set(phase, new THREE.Color(look(phase)[1]));
  return COLORS.get(phase);
}

const [UP, TURN, AT, SIZE] = [
  new THREE.Vector3(0, 0, 1), new THREE.Quaternion(), new THREE.Vector3(), new THREE.Vector3(),
];
const MATRIX = new THREE.Matrix4();

function place(mesh, index, { at: [north, east, down], yawAt }, above, scale) {
  TURN.setFromAxisAngle(UP, -yawAt);
  AT.set(east, north, above - down);
  mesh.setMatrixAt(index, MATRIX.compose(AT, TURN, SIZE.set(scale, scale, scale)));
}

function darts(colour, order) {
  const outline = [[0, 1], [0.75, -0.8], [0, -0.4], [-0.75, -0.8]];
  const shape = new THREE.Shape(outline.map(([x, y]) => new THREE.Vector2(x, y)));
  const material = new THREE.MeshBasicMaterial({
    color: colour, side: THREE.DoubleSide, depthTest: false, transparent: true, // after the walls
  });
  const mesh = new THREE.InstancedMesh(new THREE.ShapeGeometry(shape), material, MOST);
  mesh.frustumCulled = false;
  mesh.renderOrder = 10 + order;
  mesh.count = 0;
  return mesh;
}
