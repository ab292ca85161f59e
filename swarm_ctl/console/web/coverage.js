import { THREE } from "nicegui-scene";

const SEEN = [70, 140, 170];
const FRESH = "rgba(165, 225, 250, 0.7)";
const FRESH_MS = 2500;
const MARGIN = 32; // cells, when the known ground grows

// The ground that was seen, painted cell by cell into a texture that lies on the floor.
export class Coverage {
  constructor(scene, grid, world) {
    this.world = world;
    this.scene = scene;
    this.grid = grid;
    this.counts = new Map();
    this.fresh = [];
    this.low = [0, 0];
    this.size = [0, 0];
  }

  // Take indices north, east, north, east, … of cells that were seen just now.
  see(told, isFresh) {
    const cells = this.within(told);
    if (!cells.length) return;
    this.makeRoom(cells);
    const now = performance.now();
    for (let i = 0; i < cells.length; i += 2) {
      const key = `${cells[i]} ${cells[i + 1]}`;
      this.counts.set(key, (this.counts.get(key) ?? 0) + 1);
      this.paint(cells[i], cells[i + 1], isFresh);
      if (isFresh) this.fresh.push([now, cells[i], cells[i + 1]]);
    }
    this.texture.needsUpdate = true;
  }

  // Leave out what lies behind the walls of a closed world: vehicles see through them.
  within(cells) {
    if (!this.world?.closed) return cells;
    const { cell_m, north_m, east_m } = this.grid;
    const [low, high] = [this.world.low, this.world.high];
    const isIn = (index, from, axis) => {
      const middle = from + (index + 0.5) * cell_m;
      return middle > low[axis] && middle < high[axis];
    };
    return cells.flatMap((north, i) => {
      if (i % 2) return [];
      const east = cells[i + 1];
      return isIn(north, north_m, 0) && isIn(east, east_m, 1) ? [north, east] : [];
    });
  }

  // Let what was new a while ago look like the rest; true while something is new.
  age() {
    const before = performance.now() - FRESH_MS;
    let aged = 0;
    while (aged < this.fresh.length && this.fresh[aged][0] < before) {
      this.paint(this.fresh[aged][1], this.fresh[aged][2], false);
      aged += 1;
    }
    if (aged) {
      this.fresh.splice(0, aged);
      this.texture.needsUpdate = true;
    }
    return this.fresh.length > 0;
  }

  paint(north, east, isFresh) {
    const x = east - this.low[1];
    const y = this.size[0] - 1 - (north - this.low[0]);
    const share = Math.min(1, (this.counts.get(`${north} ${east}`) ?? 1) / this.grid.layers);
    this.context.clearRect(x, y, 1, 1);
    this.context.fillStyle = isFresh ? FRESH : `rgba(${SEEN}, ${0.14 + 0.28 * share})`;
    this.context.fillRect(x, y, 1, 1);
  }

  makeRoom(cells) {
    let [south, west] = this.low;
    let [north, east] = [south + this.size[0] - 1, west + this.size[1] - 1];
    if (!this.size[0]) [south, west, north, east] = [cells[0], cells[1], cells[0], cells[1]];
    let fits = this.size[0] > 0;
    for (let i = 0; i < cells.length; i += 2) {
      const [row, column] = [cells[i], cells[i + 1]];
      if (row < south) [south, fits] = [row - MARGIN, false];
      if (row > north) [north, fits] = [row + MARGIN, false];
      if (column < west) [west, fits] = [column - MARGIN, false];
      if (column > east) [east, fits] = [column + MARGIN, false];
    }
    if (!fits) this.grow(south, west, north - south + 1, east - west + 1);
  }

  grow(south, west, rows, columns) {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [columns, rows];
    const context = canvas.getContext("2d");
    if (this.canvas) {
      const down = south + rows - (this.low[0] + this.size[0]);
      context.drawImage(this.canvas, this.low[1] - west, down);
    }
    [this.canvas, this.context] = [canvas, context];
    [this.low, this.size] = [[south, west], [rows, columns]];
    this.remove();
    this.texture = new THREE.CanvasTexture(canvas);
    this.texture.magFilter = THREE.NearestFilter;
    this.texture.colorSpace = THREE.SRGBColorSpace;
    const { cell_m, north_m, east_m } = this.grid;
    this.mesh = new THREE.Mesh(
      new THREE.PlaneGeometry(columns * cell_m, rows * cell_m),
      new THREE.MeshBasicMaterial({ map: this.texture, transparent: true, depthWrite: false }),
    );
    this.mesh.position.set(
      east_m + (west + columns / 2) * cell_m, north_m + (south + rows / 2) * cell_m, 0.02,
    );
    this.scene.add(this.mesh);
  }

  remove() {
    if (!this.mesh) return;
    this.scene.remove(this.mesh);
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
    this.texture.dispose();
    this.mesh = null;
  }
}
