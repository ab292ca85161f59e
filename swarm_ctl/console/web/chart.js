import { clock } from "./phases.js";

const STEPS_S = [5, 10, 15, 30, 60, 120, 300, 600, 1200, 1800, 3600];
const [LEFT, RIGHT, TOP, BOTTOM] = [44, 12, 10, 20];

// What was explored over time, when victims were found, and where in time we are.
export default {
  props: { curve: Array, found: Array, time: Number, until: Number, unit: String },
  emits: ["seek"],
  template: `
    <svg class="chart" ref="svg" :viewBox="'0 0 ' + width + ' ' + height" @pointerdown="begin"
        @pointermove="drag" @pointerup="held = false">
      <g v-for="tick in yTicks" :key="'y' + tick">
        <line class="grid" :x1="${LEFT}" :x2="width - ${RIGHT}" :y1="y(tick)" :y2="y(tick)"/>
        <text class="tick" :x="${LEFT - 6}" :y="y(tick) + 3.5" text-anchor="end">{{ tick }}</text>
      </g>
      <text v-for="tick in xTicks" :key="'x' + tick" class="tick" :x="x(tick)" :y="height - 5"
        text-anchor="middle">{{ clock(tick) }}</text>
      <path class="later" :d="path"/>
      <clipPath id="past"><rect x="0" y="0" :width="x(time)" :height="height"/></clipPath>
      <path class="area" :d="area" clip-path="url(#past)"/>
      <path class="line" :d="path" clip-path="url(#past)"/>
      <line v-for="(t, i) in found" :key="i" class="found" :x1="x(t)" :x2="x(t)" y1="${TOP}"
        :y2="height - ${BOTTOM}" :opacity="t <= time ? 0.9 : 0.25"/>
      <line class="now" :x1="x(time)" :x2="x(time)" y1="${TOP - 4}" :y2="height - ${BOTTOM}"/>
    </svg>`,
  data: () => ({ width: 900, height: 150, held: false }),
  mounted() {
    this.sizing = new ResizeObserver(([entry]) => {
      this.width = Math.max(200, entry.contentRect.width);
      this.height = Math.max(80, entry.contentRect.height);
    });
    this.sizing.observe(this.$refs.svg);
  },
  unmounted() {
    this.sizing.disconnect();
  },
  computed: {
    end() {
      return Math.max(this.until || 0, this.time, 30);
    },
    most() {
      if (this.unit === "%") return 100;
      return this.curve.reduce((most, [, value]) => Math.max(most, value), 10);
    },
    step() {
      return roundUp(this.most / 4);
    },
    top() {
      return this.step * Math.ceil(this.most / this.step);
    },
    xTicks() {
      const size = STEPS_S.find((step) => this.end / step <= 9) ?? 7200;
      return multiples(size, this.end);
    },
    yTicks() {
      return multiples(this.step, this.top);
    },
    path() {
      return this.curve.map(([t, value], i) => `${i ? "L" : "M"}${this.dot(t, value)}`).join("");
    },
    area() {
      if (!this.curve.length) return "";
      const [first, last] = [this.curve[0][0], this.curve[this.curve.length - 1][0]];
      return `${this.path}L${this.dot(last, 0)}L${this.dot(first, 0)}Z`;
    },
  },
  methods: {
    clock,
    x(time) {
      return LEFT + (time / this.end) * (this.width - LEFT - RIGHT);
    },
    y(value) {
      return this.height - BOTTOM - (value / this.top) * (this.height - TOP - BOTTOM);
    },
    dot(time, value) {
      return `${this.x(time).toFixed(1)} ${this.y(value).toFixed(1)}`;
    },
    begin(event) {
      this.held = true;
      this.drag(event);
    },
    drag(event) {
      if (!this.held || !event.buttons) return;
      const at = event.clientX - this.$refs.svg.getBoundingClientRect().left;
      const share = (at - LEFT) / (this.width - LEFT - RIGHT);
      this.$emit("seek", Math.min(1, Math.max(0, share)) * this.end);
    },
  },
};

function roundUp(value) {
  const unit = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 2.5, 5, 10].map((n) => n * unit).find((n) => n >= value);
}

const multiples = (size, end) =>
  Array.from({ length: Math.floor(end / size + 1e-9) + 1 }, (_, i) => +(i * size).toFixed(2));
