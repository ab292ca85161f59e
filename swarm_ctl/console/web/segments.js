import { THREE } from "nicegui-scene";

// Lines that are drawn anew again and again, without a new object for any of them.
export class Segments {
  // With a colour for all, or with `null` and a colour for each end.
  constructor(scene, most, color, opacity = 1) {
    this.most = most;
    const geometry = new THREE.BufferGeometry();
    this.places = buffer(geometry, "position", most);
    if (!color) this.colors = buffer(geometry, "color", most);
    const look = color ? { color } : { vertexColors: true };
    const material = new THREE.LineBasicMaterial({ ...look, opacity, transparent: true });
    this.mesh = new THREE.LineSegments(geometry, material);
    this.mesh.frustumCulled = false;
    this.count = 0;
    scene.add(this.mesh);
  }

  clear() {
    this.count = 0;
  }

  // From one place to another: lists of north, east, down.
  add(from, to, colorFrom, colorTo) {
    if (this.count >= this.most) return;
    const at = 6 * this.count;
    this.places.array.set([from[1], from[0], -from[2], to[1], to[0], -to[2]], at);
    if (this.colors) {
      colorFrom.toArray(this.colors.array, at);
      colorTo.toArray(this.colors.array, at + 3);
    }
    this.count += 1;
  }

  show() {
    this.places.needsUpdate = true;
    if (this.colors) this.colors.needsUpdate = true;
    this.mesh.geometry.setDrawRange(0, 2 * this.count);
  }
}

function buffer(geometry, name, most) {
  const attribute = new THREE.BufferAttribute(new Float32Array(6 * most), 3);
  attribute.setUsage(THREE.DynamicDrawUsage);
  geometry.setAttribute(name, attribute);
  return attribute;
}
