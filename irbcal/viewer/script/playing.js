// --- playing -----------------------------------------------------------------------------------------------
const STEP = 0.8, REST = 0.35; // seconds for a way between poses, and at a pose, at speed 1
function pause() {
  state.playing = false;
  state.travel = null;
  byId("play").textContent = "▶";
}
function play() {
  if (state.playing) {
    pause();
    show_pose(state.at);
    return;
  }
  if (state.active.length < 2) return;
  if (state.at === state.active.length - 1) show_pose(0);
  state.playing = true;
  state.travel = { time: 0, from: state.pose };
  byId("play").textContent = "❙❙";
  let last = performance.now();
  const frame = (now) => {
    if (!state.playing) return;
    const travel = state.travel;
    travel.time += (state.speed * Math.min(now - last, 200)) / 1e3;
    last = now;
    if (travel.time >= STEP + REST || travel.from === state.pose) {
      if (travel.from !== state.pose) travel.time -= STEP + REST;
      if (state.at === state.active.length - 1) {
        pause();
        show_pose(state.at);
        return;
      }
      travel.from = state.pose;
      show_pose(state.at + 1, true);
    }
    const part = Math.min(Math.max(travel.time / STEP, 0), 1);
    move_robot(...on_way(travel.from, state.pose, part));
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
}

