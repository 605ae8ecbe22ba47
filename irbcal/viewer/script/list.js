// --- the list of poses, and the ways to one ------------------------------------------------------------------
const MOST_IN_LIST = 500;
let listed = new Map(); // button of each pose
function list_poses(everything) {
  if (!measured) return;
  const error = largest[state.model];
  const order = state.order === "error" ? [...state.active].sort((a, b) => error[b] - error[a]) : state.active;
  const shown = everything ? order : order.slice(0, MOST_IN_LIST);
  listed = new Map();
  const lines = shown.map((pose) => {
    const line = element("button");
    line.type = "button";
    line.dataset.pose = pose;
    const chip = element("span", undefined, "chip");
    chip.style.background = colour_of(error[pose]).getStyle();
    line.append(chip, element("span", String(poses.ids[pose]), "id"));
    if (both_kinds) line.append(element("span", KINDS[kind_of(pose)], kind_of(pose) ? "kind fitted" : "kind"));
    line.append(element("span", number(error[pose], 3), "mm"));
    listed.set(pose, line);
    return line;
  });
  if (shown.length < order.length) {
    const more = element("button", `${order.length - shown.length} more`, "more");
    more.type = "button";
    lines.push(more);
  }
  byId("list").replaceChildren(...lines);
  byId("listing").textContent = `${model_words(state.model)}, largest of each pose, mm`;
  mark_in_list();
}
function mark_in_list() {
  const list = byId("list");
  for (const line of list.querySelectorAll("[aria-current]")) line.removeAttribute("aria-current");
  const line = listed.get(state.pose);
  if (!line) return;
  line.setAttribute("aria-current", "true");
  if (!state.begun) return; // at first the list begins with the worst
  const top = line.offsetTop - list.offsetTop;
  if (top < list.scrollTop || top + line.offsetHeight > list.scrollTop + list.clientHeight)
    list.scrollTop = top - list.clientHeight / 2;
}
function go_to_pose(pose, closer) {
  const at = state.active.indexOf(pose);
  if (at < 0) return false;
  pause();
  show_pose(at);
  if (closer) look_at_pose();
  return true;
}
byId("list").addEventListener("click", (event) => {
  const line = event.target.closest("button");
  if (!line) return;
  if (line.dataset.pose === undefined) list_poses(true);
  else go_to_pose(Number(line.dataset.pose), true);
});
function worst() {
  if (!measured || !state.active.length) return;
  go_to_pose(state.active.reduce((best, pose) => (largest[state.model][pose] > largest[state.model][best] ? pose : best)), true);
}

const field = byId("goto");
function go_to_field() {
  const wanted = field.value.trim();
  const pose = poses.ids.findIndex((name) => String(name) === wanted);
  const problem = !wanted ? "" : pose < 0 ? `no pose ${wanted}` : state.active.includes(pose) ? "" : `pose ${wanted} is not chosen`;
  field.setAttribute("aria-invalid", problem ? "true" : "false");
  byId("problem").textContent = problem;
  if (wanted && !problem) {
    go_to_pose(pose, measured);
    field.value = "";
    field.blur();
  }
}
field.addEventListener("keydown", (event) => {
  if (event.key === "Enter") go_to_field();
  if (event.key === "Escape") {
    field.value = "";
    go_to_field();
    field.blur();
  }
});
field.addEventListener("change", go_to_field);
