// --- keys and buttons ----------------------------------------------------------------------------------------
const step = (at) => {
  pause();
  show_pose(at);
};
const actions = {
  ArrowLeft: () => step(state.at - 1), ArrowRight: () => step(state.at + 1),
  Home: () => step(0), End: () => step(state.active.length - 1), " ": play,
  w: worst, f: () => measured && look_at_pose(), a: () => (in_plan ? set_whole(!state.whole) : points && set_which(state.which === "all" ? "worst" : "all")),
  o: () => measured && set_own(!state.own), g: () => {
    field.focus();
    field.select();
  }, b: () => measured && set_model(state.model === "nominal" ? "calibrated" : "nominal"),
};
const camera_actions = { t: () => look(true), r: () => look(false), d: () => set_theme(is_dark() ? "light" : "dark") };
document.addEventListener("keydown", (event) => {
  const own = event.target.tagName + (event.target.type || "");
  if (event.ctrlKey || event.metaKey || event.altKey || /^SELECT|^INPUTradio|^INPUTtext/.test(own)) return;
  if (event.key === " " && /^BUTTON|^INPUTcheckbox/.test(own)) return; // the space bar is theirs
  const act = camera_actions[event.key] || (poses.count && actions[event.key]);
  if (!act) return;
  event.preventDefault();
  act();
});
byId("slider").addEventListener("input", (event) => step(Number(event.target.value)));
for (const [id, act] of [["first", actions.Home], ["previous", actions.ArrowLeft], ["play", play], ["next", actions.ArrowRight],
  ["last", actions.End], ["worst", worst], ["whole", actions.a], ["near", camera_actions.r], ["far", camera_actions.t],
  ["theme", camera_actions.d]])
  byId(id).addEventListener("click", (event) => {
    event.currentTarget.blur(); // the space bar plays, and does not press this button again
    act();
  });
byId("gui").addEventListener("click", () => {
  const style = viewer.gui.domElement.style;
  style.display = style.display === "none" ? "" : "none";
  if (style.display === "") viewer.gui.open();
});

// --- begin ---------------------------------------------------------------------------------------------------
viewer.set_3d_pane_size();
if (data.mode === "sliders") {
  move_robot(state.q, effective(state.q));
  tell_pose();
} else activate();
function go_to_address() { // view.html#pose=NAME, as the report links to it
  const wanted = new URLSearchParams(location.hash.slice(1)).get("pose");
  const at = wanted === null ? -1 : state.active.findIndex((pose) => String(poses.ids[pose]) === wanted);
  if (at >= 0) step(at);
  if (at >= 0 && measured) look_at_pose();
}
addEventListener("hashchange", go_to_address);
look(false);
state.begun = true;
go_to_address();
viewer.render();
byId("waiting").remove();
window.irbcalView = { viewer, state, poses, points, body, slots: () => slots, labels, hurry, on_screen, point, magnification, top_mm,
  largest, seconds: (performance.now() - started) / 1e3 };
