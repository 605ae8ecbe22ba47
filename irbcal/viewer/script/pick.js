// --- a point under the pointer -------------------------------------------------------------------------------
const canvas = viewer.renderer.domElement;
function from_segment(x, y, a, b) { // pixels from a line's piece
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
  const part = Math.min(Math.max(((x - a[0]) * dx + (y - a[1]) * dy) / (dx * dx + dy * dy || 1), 0), 1);
  return Math.hypot(x - a[0] - part * dx, y - a[1] - part * dy);
}
function point_at(x, y, within) { // the row of the point that a ray through a pixel meets first, or -1
  if (!points) return -1;
  const found = [];
  for (let row = 0; row < total; row++) {
    if (slots[row] < 0) continue;
    const from = point(points.at[state.model], row);
    const a = on_screen(from);
    if (a[2] >= 1) continue;
    let away = Infinity;
    if (state.layers.modelled) away = Math.hypot(x - a[0], y - a[1]);
    if (measured && state.layers.measured) {
      const m = on_screen(point(points.measured, row));
      away = Math.min(away, Math.hypot(x - m[0], y - m[1]));
    }
    if (measured && state.layers.vectors) {
      const b = on_screen(from.clone().addScaledVector(point(points.error[state.model], row), magnification()));
      if (b[2] < 1) away = Math.min(away, from_segment(x, y, a, b));
    }
    if (away <= within) found.push({ row, away, depth: a[2], from });
  }
  found.sort((a, b) => (Math.abs(a.away - b.away) > 3 ? a.away - b.away : a.depth - b.depth));
  viewer.scene.updateMatrixWorld();
  const hit = found.slice(0, 6).find((one) => !hidden(one.from, 4 * radius));
  return hit ? hit.row : -1;
}
const place_in_canvas = (event) => {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
};
const reach_of = (event) => (event.pointerType === "touch" ? 22 : 9); // pixels: a finger is wide

let press = null, fingers = 0;
canvas.addEventListener("pointerdown", (event) => {
  fingers++;
  byId("hint").hidden = true;
  press = event.button === 0 && fingers === 1 ? { x: event.clientX, y: event.clientY, time: event.timeStamp } : null;
});
addEventListener("pointercancel", () => {
  fingers = 0;
  press = null;
});
addEventListener("pointerup", (event) => {
  fingers = Math.max(fingers - 1, 0);
  const start = press;
  press = null;
  if (!start || event.timeStamp - start.time > 700 || Math.hypot(event.clientX - start.x, event.clientY - start.y) > 6) return;
  const row = point_at(...place_in_canvas(event), reach_of(event));
  if (row >= 0) go_to_pose(points.pose[row], false);
});
let hover = null;
canvas.addEventListener("pointermove", (event) => {
  if (event.pointerType === "touch" || event.buttons || state.playing || !points) return;
  if (!hover)
    requestAnimationFrame(() => {
      const [x, y] = place_in_canvas(hover);
      const row = point_at(x, y, reach_of(hover));
      hover = null;
      const hint = byId("hint");
      hint.hidden = row < 0;
      canvas.style.cursor = row < 0 ? "" : "pointer";
      if (row < 0) return;
      const pose = points.pose[row];
      const error = measured ? ` · ${number(size[state.model][row], 3)} mm` : "";
      hint.textContent = `pose ${poses.ids[pose]} · ${data.targets[points.target[row]].name}${error}${poses.fitted ? ` · ${KINDS[kind_of(pose)]}` : ""}`;
      const left = Math.min(x + 14, pane.clientWidth - hint.offsetWidth - 4);
      hint.style.transform = `translate(${Math.max(left, 4)}px, ${Math.max(y - 30, 4)}px)`;
    });
  hover = event;
});
canvas.addEventListener("pointerleave", () => (byId("hint").hidden = true));
