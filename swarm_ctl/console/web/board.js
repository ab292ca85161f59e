import { Chart, Scene, clock, look, urgency, vehicle } from "swarm-console";

const LONG_TABLE = 26; // more vehicles than this are sorted by who wants an eye
const SPEEDS = [0.5, 1, 2, 5, 10, 20];
// Each order's word, and what it tells all vehicles, or one, to do.
const ORDERS = [
  ["start", "Start", "Those that stand ready take off and explore.", "It takes off and explores."],
  ["pause", "Hold", "All hold where they are until they are told to resume.",
    "It holds where it is until it is told to resume."],
  ["resume", "Resume", "All go on with the mission. Those that a pilot flies are taken back.",
    "It goes on with the mission. If a pilot flies it, it is taken back."],
  ["return", "Return", "All fly home and land there.", "It flies home and lands there."],
  ["land", "Land", "All land where they are.", "It lands where it is."],
  ["abort", "Abort", "The mission ends: all land where they are.",
    "Its mission ends: it lands where it is."],
];

const few = (sysids) =>
  sysids.length > 4 ? `${sysids.slice(0, 4).join(", ")} and ${sysids.length - 4} more` : sysids.join(", ");

// The operator's page. The server sends one frame after another (picture.py), and each is drawn whole.
export default {
  components: { Chart },
  emits: ["ready", "drawn", "order", "choose", "play", "seek", "speed"],
  template: `
  <div class="board" :class="{ replay: isReplay, dense: rows.length > ${LONG_TABLE} }">
    <header>
      <div class="name">
        <select v-if="missions.length > 1" :value="head.mission" aria-label="mission"
          @change="$emit('choose', $event.target.value)">
          <option v-for="one in missions" :key="one">{{ one }}</option></select>
        <b v-else>{{ head.mission || "No mission yet" }}</b>
        <span class="mode" :class="head.mode">{{ isReplay ? "replay" : "live" }}</span></div>
      <div class="fact" data-fact="time"><b>{{ clock(time) }}</b><i>mission time</i></div>
      <div class="fact" data-fact="air"><b>{{ airborne }}<s>/{{ rows.length }}</s></b><i>in the air</i></div>
      <div class="fact" data-fact="seen"><b>{{ explored }}</b><i>explored</i></div>
      <div class="fact" data-fact="victims"><b>{{ victims.length }}<s v-if="head.victims_total">/{{ head.victims_total }}</s></b><i>victims found</i></div>
      <div class="fill"></div>
      <div v-if="!isReplay" class="orders">
        <span class="answer" role="status" :class="{ bad: answered.isBad }">{{ answered.words }}</span>
        <span class="whom">{{ whom }}</span>
        <button v-for="[order, word] in offered" :key="order" :class="order" :data-order="order"
          :disabled="!rows.length" @click="ask(order)">{{ word }}</button>
      </div>
      <span v-else class="run" :title="head.run">{{ head.run }}</span>
    </header>
    <main>
      <div class="scene" ref="scene">
        <div class="warning" v-if="warning" role="alert">{{ warning }}</div>
        <div class="keys">drag to turn · right button to move · wheel to zoom · grid {{ grid }} m
          <button @click="drawing?.fit()">whole view</button></div>
        <div class="lost" v-if="unplaced">{{ unplaced }}</div>
      </div>
      <div class="timeline">
        <h2>{{ unit === "%" ? "Explored, %" : "Explored, " + unit }}</h2>
        <chart :curve="shownCurve" :found="found" :time="time" :until="head.duration_s" :unit="unit"
          @seek="seek"/>
      </div>
      <div class="transport" v-if="isReplay">
        <button class="play" @click="play(!playing)" :aria-label="playing ? 'pause' : 'play'">
          {{ playing ? "❚❚" : "▶" }}</button>
        <input type="range" min="0" :max="head.duration_s" step="any" :value="time"
          aria-label="mission time" @input="seek(+$event.target.value)">
        <span class="clock">{{ clock(time) }} / {{ clock(head.duration_s || 0) }}</span>
        <span class="speeds"><button v-for="one in speeds" :key="one" :class="{ on: one === speed }"
          @click="setSpeed(one)">{{ one }}×</button></span>
      </div>
    </main>
    <aside>
      <div class="phases" role="img" :aria-label="'phases: ' + phases.map((p) => p[1] + ' ' + p[0]).join(', ')">
        <span v-for="[phase, count] in phases" :key="phase" :style="{ flexGrow: count }">
          <i :style="{ background: look(phase)[1] }"></i>
          <em><b :style="{ color: look(phase)[1] }">{{ look(phase)[0] }}</b> {{ count }} {{ phase }}</em></span>
      </div>
      <div class="table"><table>
        <thead><tr><th></th><th>phase</th><th>battery</th><th>link</th><th>neighbours</th>
          <th>last event</th></tr></thead>
        <tbody><tr v-for="one in sorted" :key="one.sysid" :data-sysid="one.sysid"
            :data-phase="one.phase" :class="{ on: one.sysid === selected }"
            @click="select(one.sysid === selected ? null : one.sysid)">
          <td class="id">{{ one.sysid }}</td>
          <td class="phase" :style="{ color: look(one.phase)[1] }"><i>{{ look(one.phase)[0] }}</i>{{ one.phase }}</td>
          <td class="battery" :class="{ low: one.battery !== null && one.battery < 25 }">
            <template v-if="one.battery !== null"><i><u :style="{ width: one.battery + '%' }"></u></i>{{ one.battery }}%</template>
            <template v-else>–</template></td>
          <td class="link" :class="{ low: one.silent > 1 }">{{ one.silent === null ? "–" : one.silent.toFixed(1) + " s" }}</td>
          <td class="peers" :title="one.peers.join(' ')"><b>{{ one.peers.length }}</b> {{ one.peers.join(" ") }}</td>
          <td class="note" :title="one.note">{{ one.note }}</td>
        </tr></tbody></table></div>
      <h2>Events<span v-if="selected"> of vehicle {{ selected }}</span></h2>
      <ol class="log" ref="log"><li v-for="line in shownLog" :key="line.key" :data-kind="line.kind">
        <time>{{ clock(line.time) }}</time><b>{{ line.sysid || "" }}</b><span>
          <em v-if="line.phase" :style="{ color: look(line.phase)[1] }">{{ look(line.phase)[0] }}</em>{{ line.words }}</span></li></ol>
    </aside>
    <dialog ref="dialog">
      <template v-if="asked">
        <h3>{{ asked.word }} {{ asked.whom }}?</h3>
        <p>{{ asked.effect }}</p>
        <form method="dialog"><button autofocus value="no">Cancel</button>
          <button :class="asked.order" value="yes" data-confirm @click="give">{{ asked.word }}</button></form>
      </template>
    </dialog>
  </div>`,
  data: () => ({
    lines: 0,    head: {}, time: 0, rows: [], victims: [], curve: [], log: [], warning: "", selected: null,
    missions: [], answer: null, asked: null, playing: false, speed: 1, speeds: SPEEDS, look, grid: 5,
  }),
  mounted() {
    try {
      this.drawing = Vue.markRaw(new Scene(this.$refs.scene, (sysid) => this.select(sysid)));
    } catch (error) {
      this.$refs.scene.dataset.fault = `This browser draws nothing in three dimensions: ${error.message}`;
    }
    window.addEventListener("keydown", this.press);
    this.$emit("ready");
  },
  unmounted() {
    window.removeEventListener("keydown", this.press);
    this.drawing?.dispose();
  },
  computed: {
    isReplay() {
      return this.head.mode === "replay";
    },
    unit() {
      return this.head.unit ?? "m²";
    },
    airborne() {
      return this.rows.filter((one) => one.isAirborne).length;
    },
    shownCurve() {
      return this.head.curve ?? this.curve;
    },
    found() {
      return this.head.found_s ?? this.victims.map(([, , , time]) => time);
    },
    explored() {
      const past = this.shownCurve.filter(([time]) => time <= this.time);
      if (!past.length) return "–";
      const value = past[past.length - 1][1];
      return this.unit === "%" ? `${value.toFixed(1)} %` : `${value.toFixed(0)} ${this.unit}`;
    },
    sorted() {
      if (this.rows.length <= LONG_TABLE) return this.rows;
      return [...this.rows].sort((a, b) => urgency(a.phase) - urgency(b.phase) || a.sysid - b.sysid);
    },
    phases() {
      const counts = new Map();
      for (const { phase } of this.rows) counts.set(phase, (counts.get(phase) ?? 0) + 1);
      return [...counts].sort((a, b) => b[1] - a[1]);
    },
    shownLog() {
      const lines = this.log.filter((line) => !this.selected || line.sysid === this.selected);
      return lines.slice(-200).reverse();
    },
    offered() {
      const mayStart = this.rows.some((one) => one.isWaiting);
      return ORDERS.filter(([order]) => order !== "start" || mayStart);
    },
    whom() {
      if (this.selected) return `vehicle ${this.selected}`;
      return this.rows.length > 1 ? `all ${this.rows.length} vehicles` : "all vehicles";
    },
    answered() {
      if (!this.answer) return { words: "" };
      const { order, sysid, obeyed, refused, silent } = this.answer;
      const [, word] = ORDERS.find(([name]) => name === order) ?? [order, order];
      const all = obeyed + refused.length + silent.length;
      const parts = [sysid ? `${word}, vehicle ${sysid}:` : `${word}:`, `${obeyed} of ${all} obey`];
      if (refused.length) parts.push(`· ${few(refused)} refuse`);
      if (silent.length) parts.push(`· no answer from ${few(silent)}`);
      return { words: parts.join(" "), isBad: refused.length + silent.length > 0 };
    },
    unplaced() {
      if (this.head.note) return this.head.note;
      const lost = this.rows.filter((one) => !one.place).length;
      if (!lost || !this.rows.length) return "";
      return `${lost} of ${this.rows.length} not drawn: nobody knows yet where they are`;
    },
  },
  methods: {
    show(frame) {
      if (frame.reset) [this.curve, this.log] = [[], []];
      if (frame.head) {
        this.head = Object.freeze(frame.head);
        this.drawing?.begin(this.head);
      }
      const rows = frame.vehicles.map(vehicle);
      this.rows = Object.freeze(rows);
      this.victims = Object.freeze(frame.victims);
      this.time = frame.time;
      this.warning = frame.warning ?? "";
      this.missions = frame.missions ?? [];
      this.answer = frame.answer ?? null;
      if (frame.playing !== undefined) this.playing = frame.playing;
      if (frame.curve.length) this.curve = Object.freeze([...this.curve, ...frame.curve]);
      this.write(frame.log);
      this.drawing?.show(frame, rows);
      this.grid = this.drawing?.gridStep ?? 5;
      this.$nextTick(() => this.$emit("drawn"));
    },
    write(lines) {
      if (!lines.length) return;
      const phase = (kind, words) => kind === "PhaseChanged" && words.split(":")[0];
      const fresh = lines.map(([time, sysid, kind, words]) => ({
        key: (this.lines += 1), phase: phase(kind, words), time, sysid, kind, words,
      }));
      const all = [...this.log, ...fresh];
      if (all.some((line, i) => i && line.time < all[i - 1].time)) all.sort((a, b) => a.time - b.time);
      this.log = Object.freeze(all.slice(-1000));
    },
    select(sysid) {
      this.selected = sysid;
      this.drawing?.select(sysid);
    },
    ask(order) {
      const [, word, ofAll, ofOne] = ORDERS.find(([name]) => name === order);
      const effect = this.selected ? ofOne : ofAll;
      const mission = this.head.mission;
      this.asked = { mission, order, word, whom: this.whom, sysid: this.selected, effect };
      this.$nextTick(() => this.$refs.dialog.showModal());
    },
    give() {
      const { mission, order, sysid } = this.asked;
      this.$emit("order", { mission, order, sysid });
    },
    play(playing) {
      this.playing = playing;
      this.$emit("play", playing);
    },
    press({ key, target }) {
      if (this.$refs.dialog.open || target.closest("button, select")) return;
      if (key === "Escape") this.select(null);
      if (key === " " && this.isReplay) this.play(!this.playing);
    },
    seek(time) {
      if (!this.isReplay) return;
      this.time = time;
      this.$emit("seek", time);
    },
    setSpeed(speed) {
      this.speed = speed;
      this.$emit("speed", speed);
    },
    clock,
  },
};
