// --- labels ------------------------------------------------------------------------------------------------
const labels = [];
function label(text, place, layer) {
  const node = element("span", text);
  byId("labels").append(node);
  labels.push({ node, place, layer, hidden: false, half: 0 });
}
if (data.tracker) label("laser tracker", tracker.clone().add(new THREE.Vector3(0, 0, 0.14)), "tracker");
for (const item of data.references) label(item.name, new THREE.Vector3(...item.place).add(new THREE.Vector3(0, 0, 0.06)), "references");
for (const item of data.features)
  label(item.label, new THREE.Vector3(...item.place).add(new THREE.Vector3(0, 0, item.kind === "distance" ? 0 : 0.012 * data.reach)), "features");
for (const item of data.cell) {
  label(item.label, new THREE.Vector3(...item.place), "cell");
  if (item.on_tip) labels[labels.length - 1].in_tip = new THREE.Vector3(...item.place);
}
if (data.cube) {
  const edge = data.cube.edge;
  label(`ISO 9283 cube, ${number(1e3 * edge, 0)} mm`, new THREE.Vector3(...data.cube.centre).add(new THREE.Vector3(0, 0, edge / 2)), "cube");
}
if (in_plan) for (const layer of ["next", "shown"]) label("", new THREE.Vector3(), layer);
const [next_label, now_label] = labels.slice(-2);
function set_label(one, text, place) {
  one.node.textContent = text;
  one.place.copy(place);
  one.half = 0;
}
const in_world = (v) => new THREE.Vector3(v.x, v.z, -v.y); // meshcat's camera lives in axes with y up
const on_screen = (v) => { // pixels, and depth between -1 and 1 where it can be seen
  const at = in_world(v).project(viewer.camera);
  return [((at.x + 1) * pane.clientWidth) / 2, ((1 - at.y) * pane.clientHeight) / 2, at.z];
};

const ray = new THREE.Raycaster();
const bodies = data.meshes.map((k) => viewer.scene_tree.find(["irbcal", "robot", String(k), "<object>"]).object);
function hidden(v, slack) { // whether the robot stands before a place
  if (!state.layers.robot) return false;
  const to = in_world(v).sub(viewer.camera.position);
  const distance = to.length();
  ray.set(viewer.camera.position, to.divideScalar(distance));
  ray.far = distance - slack;
  return ray.intersectObjects(bodies, false).length > 0;
}
let looking = 0; // rays are cast at most ten times a second, not in every frame
function hide_labels() {
  looking = 0;
  viewer.scene.updateMatrixWorld();
  let changed = false;
  for (const one of labels) {
    const now = state.layers.labels && state.layers[one.layer] && hidden(one.place, 0.02);
    changed = changed || now !== one.hidden;
    one.hidden = now;
  }
  if (changed) place_labels();
}
function place_labels() {
  const w = pane.clientWidth;
  const taken = []; // features and poses may be close together: what would cover another label waits until the watcher is nearer
  for (const one of labels) {
    const [x, y, z] = on_screen(one.place);
    const seen = state.layers.labels && state.layers[one.layer] && one.node.textContent && !one.hidden && z < 1 && x > 0 && x < w && y > 0 && y < pane.clientHeight;
    one.node.hidden = !seen;
    if (!seen) continue;
    one.half = one.half || one.node.offsetWidth / 2;
    const middle = Math.min(Math.max(x, one.half + 2), w - one.half - 2); // not cut off at the edge
    const bottom = Math.max(y, 22);
    if (["features", "shown"].includes(one.layer) && taken.some(([at, low, half]) => Math.abs(at - middle) < half + one.half && Math.abs(low - bottom) < 18)) {
      one.node.hidden = true;
      continue;
    }
    taken.push([middle, bottom, one.half]);
    one.node.style.transform = `translate(${middle.toFixed(1)}px, ${bottom.toFixed(1)}px) translate(-50%, -100%)`;
  }
}
const render = viewer.render.bind(viewer);
viewer.render = function () {
  at_its_pace(render);
  place_labels();
  if (labels.length) looking = looking || setTimeout(hide_labels, 100);
};
