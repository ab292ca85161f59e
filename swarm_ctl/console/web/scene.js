import { OrbitControls, THREE } from "nicegui-scene";
import { Coverage } from "./coverage.js";
import { boundsOf, buildGround, gridStep } from "./ground.js";
import { Overlay } from "./overlay.js";
import { Swarm } from "./swarm.js";

const BACKGROUND = "#0c1116";
const ELEVATION = (62 * Math.PI) / 180;

// The mission in three dimensions: x east, y north, z up, metres.
export class Scene {
  constructor(host, onPick) {
    this.host = host;
    this.renderer = new THREE.WebGLRenderer({ antialias: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    host.appendChild(this.renderer.domElement);
    this.isSlow = isDrawnBySoftware(this.renderer);
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(BACKGROUND);
    this.camera = new THREE.PerspectiveCamera(32, 1, 0.1, 20000);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.maxPolarAngle = 0.49 * Math.PI;
    this.controls.addEventListener("change", () => this.request());
    this.controls.addEventListener("start", () => (this.isLedByHand = true));
    this.overlay = new Overlay(host, onPick);
    this.swarm = new Swarm(this.scene);
    this.resizing = new ResizeObserver(() => this.resize());
    this.resizing.observe(host);
    this.victims = [];
    this.shownAt = 0;
    this.resize();
  }

  // Begin with another world, or with the same one from its beginning.
  begin(head) {
    if (this.ground) this.scene.remove(this.ground);
    this.coverage?.remove();
    this.coverage = new Coverage(this.scene, head.grid, head.world);
    this.head = head;
    this.bounds = null;
    this.swarm.clear();
  }

  show(frame, vehicles) {
    const places = vehicles.map((one) => one.place).filter(Boolean);
    this.frameGround(places);
    this.coverage.see(frame.cells, !frame.reset);
    const now = performance.now();
    const since = frame.reset || this.isSlow ? 0 : Math.min(1000, now - this.shownAt);
    this.shownAt = now;
    this.swarm.show(vehicles, now, since);
    this.victims = frame.victims.filter(([, place]) => place);
    this.request();
  }

  select(sysid) {
    this.swarm.select(sysid);
    this.request();
  }

  // Draw the ground, again when vehicles of an unknown world have come to its edge.
  frameGround(places) {
    if (this.bounds && (this.head.world || places.every((one) => isWithin(one, this.bounds)))) return;
    if (this.ground) this.scene.remove(this.ground);
    this.bounds = boundsOf(this.head.world, places);
    const [west, south, east, north] = this.bounds;
    this.gridStep = gridStep(east - west, north - south);
    this.ground = buildGround(this.head.world, this.bounds, this.gridStep);
    this.scene.add(this.ground);
    if (!this.isLedByHand) this.fit();
  }

  // Look at the whole world from the south, from above.
  fit() {
    const [west, south, east, north, top] = this.bounds;
    const target = new THREE.Vector3((west + east) / 2, (south + north) / 2, 0);
    const corners = [west, east].flatMap((x) =>
      [south, north].flatMap((y) => [0, top].map((z) => new THREE.Vector3(x, y, z))),
    );
    const way = new THREE.Vector3(0, -Math.cos(ELEVATION), Math.sin(ELEVATION));
    let [near, far] = [0.1, 20 * Math.max(east - west, north - south, 10)];
    for (let step = 0; step < 24; step += 1) {
      const distance = (near + far) / 2;
      this.camera.position.copy(target).addScaledVector(way, distance);
      this.camera.lookAt(target);
      this.camera.updateMatrixWorld();
      const fits = corners.every((corner) => {
        const seen = corner.clone().project(this.camera);
        return Math.abs(seen.x) < 0.96 && Math.abs(seen.y) < 0.93 && seen.z < 1;
      });
      if (fits) far = distance;
      else near = distance;
    }
    this.camera.far = 20 * far;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(target);
    this.controls.update();
    this.isLedByHand = false;
    this.request();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (!width || !height) return;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.overlay.resize(width, height);
    if (this.bounds && !this.isLedByHand) this.fit();
    this.request();
  }

  request() {
    this.due ??= requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.due = null;
    const isMoving = this.swarm.draw(performance.now(), this.camera, this.controls.target);
    const isFresh = this.coverage?.age();
    this.renderer.render(this.scene, this.camera);
    this.overlay.draw(this.camera, this.swarm, this.victims);
    if (isMoving || (isFresh && !this.isSlow)) this.request();
  }

  dispose() {
    cancelAnimationFrame(this.due);
    this.resizing.disconnect();
    this.controls.dispose();
    this.renderer.dispose();
  }
}

const isWithin = ([north, east], [west, south, right, top]) =>
  north >= south && north <= top && east >= west && east <= right;

// Without a graphics card each picture costs the processor: then none is drawn between two frames.
function isDrawnBySoftware(renderer) {
  const context = renderer.getContext();
  const known = context.getExtension("WEBGL_debug_renderer_info");
  const name = known ? context.getParameter(known.UNMASKED_RENDERER_WEBGL) : "";
  return /swiftshader|llvmpipe|software/i.test(name);
}
