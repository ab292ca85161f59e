export { default as Chart } from "./chart.js";
export * from "./phases.js";
export { Scene } from "./scene.js";
