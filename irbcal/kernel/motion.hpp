// Commands that follow targets within limits of speed, acceleration and jerk, at any times: as irbcal/exporting/motion.py,
// which says what the numbers mean. C++17, nothing but the standard library. Seconds, radians or metres.
#ifndef IRBCAL_MOTION_HPP
#define IRBCAL_MOTION_HPP

#include <algorithm>
#include <cmath>

namespace irbcal {

constexpr double gap_s = 0.1, shortest_s = 1e-5, part_s = 1e-3, close_s = 6e-3;
constexpr double motion_rounding = 1e-6, share = 0.5, planned = 0.95, least_share = 0.1;
constexpr int halvings = 18;

inline double stop(double x, double v, double a, double acceleration, double jerk) {
  const double side = v + 0.5 * a * std::abs(a) / jerk >= 0.0 ? 1.0 : -1.0;
  v *= side;
  a *= side;
  const double top = std::max(v + 0.5 * a * a / jerk, 0.0);
  const double way = top * jerk <= acceleration * acceleration ? top * std::sqrt(top / jerk)
                                                               : 0.5 * top * (top / acceleration + acceleration / jerk);
  return x + side * (way + v * a / jerk + a * a * a / (3.0 * jerk * jerk));
}

struct Derivatives {
  double w, b, c;
};

inline Derivatives derivatives(double x, double t, const double (&before)[3], const double (&times)[3]) {
  const double first = t - times[0], second = t - times[1], third = t - times[2];
  const double d1 = (x - before[0]) / first, e1 = (before[0] - before[1]) / (times[0] - times[1]);
  const double d2 = (d1 - e1) / second;
  const double e2 = (e1 - (before[1] - before[2]) / (times[1] - times[2])) / (times[0] - times[2]);
  const double d3 = (d2 - e2) / third;
  return {d1 + first * (d2 + second * d3), 2.0 * (d2 + (first + second) * d3), 6.0 * d3};
}

struct FollowingJoint {
  double x = 0.0, v = 0.0, a = 0.0, speed, acceleration, jerk, lower, upper, room;
  double past[3], goals[3], missed[2] = {0.0, 0.0};

  void begin(double at, double most, double most_a, double most_j, double low, double high) {
    x = at;
    v = a = 0.0;
    speed = (1.0 - motion_rounding) * most;
    acceleration = (1.0 - motion_rounding) * most_a;
    jerk = (1.0 - motion_rounding) * most_j;
    lower = low;
    upper = high;
    room = most * (most / most_a + most_a / most_j);
    for (int k = 0; k < 3; ++k) past[k] = goals[k] = at;
  }
  void stand() {
    v = a = 0.0;
    for (int k = 0; k < 3; ++k) {
      past[k] = x;
      goals[k] = goals[0];
    }
  }
  double rest() const { return stop(x, v, a, acceleration, jerk); }

  int beyond_limits(double x1, double v1, double a1, double low, double high) const {
    const double end = stop(x1, v1, a1, planned * acceleration, planned * jerk);
    const double turn = v1 * a1 < 0.0 ? x1 - 0.5 * v1 * v1 / a1 : end;
    return std::max(end, turn) > high ? 1 : std::min(end, turn) < low ? -1 : 0;
  }
  bool exactly(double goal, const double (&times)[3], double t) {
    const double least = std::min({t - times[0], times[0] - times[1], times[1] - times[2]});
    if (std::max(3.0 * missed[0], missed[1]) > share * jerk * (least * least * least)) return false;
    const double v0 = (goal - past[0]) / (t - times[0]), before = (past[0] - past[1]) / (times[0] - times[1]);
    const double a1 = 2.0 * (v0 - before) / (t - times[1]);
    const double j = 3.0 * (a1 - 2.0 * (before - (past[1] - past[2]) / (times[1] - times[2])) / (times[0] - times[2])) / (t - times[2]);
    if (std::abs(v0) > speed || std::abs(a1) > acceleration || std::abs(j) > jerk) return false;
    const double v1 = v0 + 0.5 * a1 * (t - times[0]);
    if (std::abs(v1) > speed || std::abs(v1 + 0.5 * a1 * std::abs(a1) / jerk) > speed) return false;
    if (beyond_limits(goal, v1, a1, lower, upper) != 0) return false;
    x = goal;
    v = v1;
    a = a1;
    return true;
  }
  void part(double h, double goal, const Derivatives& of) {
    const double w = of.w, b = of.b, c = of.c, x0 = x, v0 = v, a0 = a;
    double low = std::max(-jerk, (-acceleration - a) / h), high = std::min(jerk, (acceleration - a) / h);
    const double least = std::max(acceleration - std::abs(b), least_share * acceleration);
    const double lowest = lower + motion_rounding, highest = upper - motion_rounding;
    const bool near = x - room < lowest || x + room > highest;
    const auto go = [&](double j) {
      x = x0 + h * (v0 + h * (a0 / 2.0 + h * j / 6.0));
      v = v0 + h * (a0 + h * j / 2.0);
      a = a0 + h * j;
    };
    const auto breaks = [&] {
      const double top = v + 0.5 * a * std::abs(a) / jerk;
      if (std::abs(top) > speed) return top > 0.0 ? 1 : -1;
      return near ? beyond_limits(x, v, a, lowest, highest) : 0;
    };
    const auto beyond = [&](double j) {
      go(j);
      const int broken = breaks();
      return broken > 0 || (broken == 0 && stop(x - goal, v - w, a - b, least, share * jerk) > 0.0);
    };
    const double parts[3] = {(goal - h * (w - h * (b / 2.0 - h * c / 6.0)) - x) / (close_s * close_s * close_s),
                             3.0 * (w - h * (b - h * c / 2.0) - v) / (close_s * close_s), 3.0 * (b - h * c - a) / close_s};
    const double close = c + parts[0] + parts[1] + parts[2];
    const double most = std::max({std::abs(parts[0]), std::abs(parts[1]), std::abs(parts[2])});
    if (most < share * jerk && low <= close && close <= high) {
      go(close);
      if (breaks() == 0) return;
    }
    double j = low;
    if (!beyond(high)) {
      j = high;
    } else if (!beyond(low)) {
      for (int k = 0; k < halvings; ++k) {
        const double middle = 0.5 * (j + high);
        if (beyond(middle)) high = middle;
        else j = middle;
      }
    }
    go(j);
  }
  double follow(double t, const double (&times)[3], double goal, bool moving) {
    const double dt = t - times[0];
    Derivatives of = derivatives(goal, t, goals, times);
    const double change = (goal - goals[0]) / dt - (goals[0] - goals[1]) / (times[0] - times[1]);
    if (!moving || std::abs(change) > acceleration * dt) of = {0.0, 0.0, 0.0};  // a jump is no speed
    if (std::abs(of.w) > speed || std::abs(of.b) > acceleration || std::abs(of.c) > jerk) of = {0.0, 0.0, 0.0};
    goals[2] = goals[1];
    goals[1] = goals[0];
    goals[0] = goal;
    if (!exactly(goal, times, t)) {
      const int parts = static_cast<int>(std::ceil(dt / part_s));
      const double h = dt / parts;
      for (int k = parts - 1; k >= 0; --k) {
        const double s = k * h;
        part(h, goal - s * (of.w - s * (of.b / 2.0 - s * of.c / 6.0)),
             {of.w - s * (of.b - s * of.c / 2.0), of.b - s * of.c, of.c});
      }
    }
    past[2] = past[1];
    past[1] = past[0];
    past[0] = x;
    missed[1] = missed[0];
    missed[0] = std::abs(x - goal);
    return x;
  }
};

template <int capacity>
struct Motion {
  int joints = capacity;
  FollowingJoint each[capacity];
  double times[3];

  void stood(double t) {
    for (int k = 0; k < 3; ++k) times[k] = t - k * shortest_s;
  }
  void follow(double t, const double* goal, bool moving, double* command) {
    if (t - times[0] > gap_s) {
      stood(t - gap_s);
      for (int i = 0; i < joints; ++i) each[i].stand();
    }
    if (t - times[0] < shortest_s) {
      for (int i = 0; i < joints; ++i) command[i] = each[i].x;
      return;
    }
    for (int i = 0; i < joints; ++i) command[i] = each[i].follow(t, times, goal[i], moving);
    times[2] = times[1];
    times[1] = times[0];
    times[0] = t;
  }
};

}  // namespace irbcal

#endif  // IRBCAL_MOTION_HPP
