// What each phase looks like: a glyph, so that no colour has to be told from another one,
// and a colour of the palette of Okabe and Ito (2008), lightened for a dark ground.
export const PHASES = {
  connecting: ["○", "#7d8b99"],
  ready: ["◔", "#a9b6c2"],
  arming: ["◑", "#a9b6c2"],
  takeoff: ["▲", "#6cc4f5"],
  exploring: ["●", "#2fc39b"],
  avoiding: ["◆", "#f0e442"],
  holding: ["‖", "#f5a623"],
  returning: ["◀", "#6cc4f5"],
  landing: ["▼", "#4f9dff"],
  yielded: ["✋", "#ffffff"],
  done: ["✓", "#7d8b99"],
  failed: ["✕", "#ff6e40"],
  lost: ["?", "#ff6e40"],
  offline: ["⌀", "#ff6e40"],
};
const AIRBORNE = new Set([
  "takeoff", "exploring", "avoiding", "holding", "returning", "landing", "yielded", "lost",
]);
// Phases that want somebody's eye come first in a long table.
const URGENT = ["offline", "failed", "lost", "yielded", "holding", "landing", "returning"];
export const VICTIM = "#ff8fc7";

export const clock = (seconds) =>
  `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;

export const look = (phase) => PHASES[phase] ?? ["·", "#dbe4ec"];

export const urgency = (phase) => {
  const place = URGENT.indexOf(phase);
  return place < 0 ? URGENT.length : place;
};

// Rows come as lists, in the order of `Vehicle.row` in picture.py.
export const vehicle = (row) => {
  const [sysid, phase, place, yaw, battery, silent, status, peers, note, trail] = row;
  const shown = status === "offline" ? "offline" : phase;
  const isWaiting = status === "waiting";
  const isAirborne = AIRBORNE.has(phase); // as far as anybody knows, also without its controller
  return { sysid, phase: shown, isWaiting, isAirborne, place, yaw, battery, silent, peers, note, trail };
};
