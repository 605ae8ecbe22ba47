const started = performance.now();
const THREE = MeshCat.THREE;
const data = JSON.parse(document.getElementById("data").textContent);
const byId = (id) => document.getElementById(id);

function bytes(text) {
  const characters = atob(text);
  const out = new Uint8Array(characters.length);
  for (let k = 0; k < out.length; k++) out[k] = characters.charCodeAt(k);
  return out;
}
const floats = (text) => (text === null ? null : new Float32Array(bytes(text).buffer));
const integers = (text) => new Int32Array(bytes(text).buffer);

function element(tag, text, className) {
  const node = document.createElement(tag);
  if (text !== undefined) node.textContent = text;
  if (className) node.className = className;
  return node;
}

// --- the viewer ------------------------------------------------------------------------------------------
const pane = byId("pane");
const viewer = new MeshCat.Viewer(pane);
viewer.set_3d_pane_size = function () {
  viewer.camera.aspect = Math.max(pane.clientWidth, 1) / Math.max(pane.clientHeight, 1);
  viewer.camera.updateProjectionMatrix();
  viewer.renderer.setSize(pane.clientWidth, pane.clientHeight);
  viewer.set_dirty();
};
new ResizeObserver(() => viewer.set_3d_pane_size()).observe(pane);
viewer.gui.domElement.style.display = "none";
for (const text of data.commands) viewer.handle_command_bytearray(bytes(text));
viewer.set_property(["Lights", "AmbientLight", "<object>"], "intensity", 0.4);
viewer.set_property(["Lights", "FillLight", "<object>"], "intensity", 0.12);
for (const light of ["PointLightNegativeX", "PointLightPositiveX"]) viewer.set_property(["Lights", light], "visible", false);
const lamp = new THREE.DirectionalLight(0xffffff, 0.47); // from over the watcher's shoulder: see look()
viewer.set_object(["Lights", "lamp"], lamp);
viewer.set_object(["Lights", "sky"], new THREE.HemisphereLight(0xffffff, 0x9aa4ad, 0.26));
const grid = new THREE.GridHelper(8, 16, 0xffffff, 0xffffff);
grid.rotateX(Math.PI / 2);
viewer.set_object(["irbcal", "floor"], grid);
byId("labels").parentNode.appendChild(byId("labels")); // above the canvas

const matrix = (values) => new THREE.Matrix4().fromArray(values);
const point = (values, k) => new THREE.Vector3(values[3 * k], values[3 * k + 1], values[3 * k + 2]);
const target_places = data.targets.map((t) => new THREE.Vector3(...t.place));
const world = matrix(data.world);
const tracker = new THREE.Vector3().setFromMatrixPosition(world);
const joints = data.joints.names.length;


// --- light and dark --------------------------------------------------------------------------------------------
const dark_system = matchMedia("(prefers-color-scheme: dark)");
let theme = "system"; // or "light" or "dark", as the button says
const is_dark = () => (theme === "system" ? dark_system.matches : theme === "dark");
const style_of = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const ink = (name) => new THREE.Color(style_of(name)); // a colour of the style sheet, as it is drawn
function paint_ground() {
  document.documentElement.dataset.theme = is_dark() ? "dark" : "light";
  const rgb = (name) => ink(name).toArray();
  viewer.handle_command({ type: "set_property", path: "/Background", property: "top_color", value: rgb("--sky") });
  viewer.handle_command({ type: "set_property", path: "/Background", property: "bottom_color", value: rgb("--ground") });
  grid.material.color.copy(ink("--grid"));
  viewer.set_dirty();
}
paint_ground();
