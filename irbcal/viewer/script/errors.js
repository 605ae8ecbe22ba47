// --- poses, points and their errors ------------------------------------------------------------------------
const poses = { ids: data.poses.ids, group: data.poses.group, groups: data.poses.groups, fitted: data.poses.fitted,
  q: floats(data.poses.q), effective: floats(data.poses.effective), count: data.poses.ids.length };
const points = data.points && { count: data.points.count, pose: integers(data.points.pose),
  target: integers(data.points.target), measured: floats(data.points.measured),
  at: { calibrated: floats(data.points.calibrated), nominal: floats(data.points.nominal) },
  error: { calibrated: floats(data.points.error_calibrated), nominal: floats(data.points.error_nominal) },
  turn: { calibrated: floats(data.points.turn_calibrated), nominal: floats(data.points.turn_nominal) },
  attitude: Object.fromEntries(Object.entries(data.points.attitudes).map(([model, text]) => [model, floats(text)])),
  without: Object.fromEntries(Object.entries(data.points.without).map(([family, text]) => [family, floats(text)])),
  u95: data.points.u95 && floats(data.points.u95) };
const U95 = "95 % of a coordinate's errors are expected within this";
const within = (row) => element("td", `± ${number(1e3 * points.u95[row], 3)}`);
const in_program = data.mode === "program"; // targets where they shall be take the place of measured points
const in_plan = data.mode === "plan";
const measured = data.mode === "measured" || in_program;
const MODELS = ["nominal", "calibrated"];
const total = points ? points.count : 0;
const rows_of = Array.from({ length: poses.count }, () => []);
if (points) points.pose.forEach((pose, row) => rows_of[pose].push(row));

// held-out and fitted poses: what the calibration has seen proves nothing
const KINDS = ["held out", "fitted"];
const kind_of = (pose) => (poses.fitted && poses.fitted[pose] ? 1 : 0);
const in_kind = [0, 0];
for (let pose = 0; pose < poses.count; pose++) in_kind[kind_of(pose)]++;
const both_kinds = !!poses.fitted && in_kind[0] > 0 && in_kind[1] > 0;

const state = { pose: 0, next: -1, at: 0, whole: false, active: [], playing: false, speed: 1, model: "calibrated", own: measured && !in_program,
  factor: Object.fromEntries(Object.entries(data.scale).map(([name, own]) => [name, own.magnification])),
  top: Object.fromEntries(Object.entries(data.scale).map(([name, own]) => [name, own.top_mm])),
  which: measured && !in_program && poses.count > 10 ? "worst" : "all", order: "error", ghost: "magnified", q: new Array(joints).fill(0),
  layers: {}, groups: poses.groups.map(() => true), kinds: [true, true], off: new Set(), travel: null };

// a family that is off moves the modelled points: the whole model says how far; several together add up
const whole = points && { at: points.at.calibrated, error: points.error.calibrated };
function leave_out() {
  if (!state.off.size) {
    points.at.calibrated = whole.at;
    points.error.calibrated = whole.error;
  } else {
    points.at.calibrated = whole.at.slice();
    points.error.calibrated = whole.error.slice();
    for (const family of state.off)
      points.without[family].forEach((shift, k) => {
        points.at.calibrated[k] += shift;
        points.error.calibrated[k] -= shift;
      });
  }
  measure();
}
const size = {}; // error of each point, mm
const largest = {}; // of each pose, mm
function nice(value, up) { // see irbcal.viewer.scales
  const decade = 10 ** Math.floor(Math.log10(value));
  const steps = [1, 2, 5, 10].map((step) => step * decade);
  return up ? steps.find((step) => step >= value * (1 - 1e-9)) : steps.reverse().find((step) => step <= value * (1 + 1e-9));
}
function measure() {
  if (!measured) return;
  for (const model of MODELS) {
    const e = points.error[model];
    size[model] = Float32Array.from({ length: total }, (_, k) => 1e3 * Math.hypot(e[3 * k], e[3 * k + 1], e[3 * k + 2]));
    largest[model] = new Float32Array(poses.count);
    points.pose.forEach((pose, row) => (largest[model][pose] = Math.max(largest[model][pose], size[model][row])));
  }
  for (const [name, own] of Object.entries(data.scale)) {
    if (name === "colours") continue;
    state.factor[name] = own.magnification;
    state.top[name] = own.top_mm;
  }
  if (state.off.size) { // errors of another model than the calibrated one have a scale of their own
    const mean = size.calibrated.reduce((a, b) => a + b, 0) / total;
    state.top.calibrated = nice(largest.calibrated.reduce((a, b) => Math.max(a, b), 0), true);
    state.factor.calibrated = nice((70 * data.reach) / mean, false);
  }
  state.turning = {}; // frames: errors of about ten degrees can be seen
  for (const model of MODELS) {
    let sum = 0, n = 0;
    for (const row of oriented) {
      const v = points.attitude[model].subarray(6 * row + 3, 6 * row + 6);
      sum += Math.hypot(...v);
      n++;
    }
    state.turning[model] = n && sum / n > 1e-9 ? Math.max(nice(0.2 / (sum / n), false), 1) : 1;
  }
}
const oriented = []; // points with a measured orientation
if (measured && points.attitude.calibrated)
  for (let row = 0; row < total; row++) if (!Number.isNaN(points.attitude.calibrated[6 * row])) oriented.push(row);
measure();
const scale_name = () => (state.own && data.scale[state.model] ? state.model : "common");
const magnification = () => state.factor[scale_name()];
const top_mm = () => state.top[scale_name()];
const model_words = (model) =>
  in_program ? { nominal: "before", calibrated: "after" }[model]
    : model === "calibrated" && state.off.size ? `without ${[...state.off].join(", ")}` : model;
if (in_program) {
  for (const input of document.querySelectorAll('input[name="model"]')) input.nextSibling.textContent = model_words(input.value);
  document.querySelector("#listed h2").textContent = "Targets";
  document.getElementById("meaning").textContent = "error vectors (from where it goes to where it shall)";
}

const group_on = (pose) => state.groups[poses.group[pose]] && state.kinds[kind_of(pose)];
let worst_tenth = new Set();
function rank() {
  if (!measured) return;
  const ranked = [...state.active].sort((a, b) => largest[state.model][b] - largest[state.model][a]);
  worst_tenth = new Set(ranked.slice(0, Math.ceil(ranked.length / 10)));
}
const is_drawn = (pose) => group_on(pose)
  && (state.which === "all" || pose === state.pose || (state.which === "worst" && worst_tenth.has(pose)));
