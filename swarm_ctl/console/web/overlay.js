import { THREE } from "nicegui-scene";
import { VICTIM } from "./phases.js";

const HALO = "#0c1116";
const NEAR_PX = 16;

// What is written over the scene in pixels: names of vehicles, victims, who is chosen.
export class Overlay {
  constructor(host, onPick) {
    this.canvas = document.createElement("canvas");
    this.canvas.className = "overlay";
    host.appendChild(this.canvas);
    this.context = this.canvas.getContext("2d");
    this.spots = [];
    let down = null;
    host.addEventListener("pointerdown", (event) => (down = [event.offsetX, event.offsetY]));
    host.addEventListener("pointerup", (event) => {
      const [x, y] = [event.offsetX, event.offsetY];
      if (down && Math.hypot(x - down[0], y - down[1]) < 4) onPick(this.nearest(x, y));
    });
  }

  resize(width, height) {
    const ratio = Math.min(window.devicePixelRatio, 2);
    [this.canvas.width, this.canvas.height] = [ratio * width, ratio * height];
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    [this.width, this.height] = [width, height];
  }

  draw(camera, swarm, victims) {
    this.context.clearRect(0, 0, this.width, this.height);
    this.context.textBaseline = "middle";
    this.context.font = "600 11px Roboto, sans-serif";
    const found = victims.map(([number, place]) => [number, this.pixel(place, camera)]);
    for (const [number, pixel] of found.filter(([, seen]) => seen)) {
      this.write(`victim ${number}`, pixel[0] + 12, pixel[1], VICTIM);
    }
    for (const [, pixel] of found.filter(([, seen]) => seen)) this.cross(pixel);
    this.spots = [];
    for (const { at, row } of swarm.vehicles.values()) {
      const pixel = at && this.pixel(at, camera);
      if (!pixel) continue;
      this.spots.push([row.sysid, ...pixel]);
      if (row.sysid === swarm.selected) this.ring(pixel);
      this.write(row.sysid, pixel[0] + 10, pixel[1] - 9, "#e8eef4");
    }
  }

  cross([x, y]) {
    const { context } = this;
    context.beginPath();
    context.arc(x, y, 8, 0, 2 * Math.PI);
    context.fillStyle = HALO;
    context.fill();
    context.lineWidth = 1.5;
    context.strokeStyle = VICTIM;
    context.stroke();
    context.fillStyle = VICTIM;
    context.fillRect(x - 4.5, y - 1.5, 9, 3);
    context.fillRect(x - 1.5, y - 4.5, 3, 9);
  }

  ring([x, y]) {
    this.context.beginPath();
    this.context.arc(x, y, 15, 0, 2 * Math.PI);
    this.context.lineWidth = 1.5;
    this.context.strokeStyle = "#ffffff";
    this.context.stroke();
  }

  write(text, x, y, colour) {
    this.context.lineWidth = 3;
    this.context.strokeStyle = HALO;
    this.context.strokeText(text, x, y);
    this.context.fillStyle = colour;
    this.context.fillText(text, x, y);
  }

  pixel([north, east, down], camera) {
    const seen = new THREE.Vector3(east, north, -down).project(camera);
    if (seen.z > 1) return null;
    return [((seen.x + 1) / 2) * this.width, ((1 - seen.y) / 2) * this.height];
  }

  nearest(x, y) {
    const away = ([, a, b]) => Math.hypot(a - x, b - y);
    const best = this.spots.reduce((p, q) => (p && away(p) <= away(q) ? p : q), null);
    return best && away(best) < NEAR_PX ? best[0] : null;
  }
}
