// kernel.hpp for Python: one class, Kernel, whose methods read and write arrays of doubles that numpy made.
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <new>
#include <vector>

#include "kernel.hpp"

#if defined(__x86_64__) && defined(__GNUC__)
#define SIDE_BY_SIDE __attribute__((target("avx2,fma"), flatten))
#endif

namespace {

using namespace irbcal;

constexpr int most_joints = 12, most_orders = 128;
constexpr Py_ssize_t few = 4, worth_unlocking = 64;

struct Robot {
  static constexpr int capacity = most_joints;
  int joints = 0, orders = 0, waves = 0, bends = 0, levers = 0;
  bool has_map = false, has_payload = false, has_history = false, has_closed_form = false;
  bool slides[capacity] = {};
  double far[capacity], lower[capacity], upper[capacity];
  Constant chain[capacity], nominal[capacity], tip, nominal_tip;
  double gravity[3] = {}, payload_kg = 0.0, payload_place[3] = {};
  double gain[capacity] = {}, offset[capacity] = {}, compliance[capacity] = {};
  double direction[capacity] = {}, width[capacity], move[capacity] = {}, share[capacity] = {};
  double cosine[most_orders][capacity] = {}, sine[most_orders][capacity] = {};
  std::vector<Wave> wave;
  std::vector<Bend<capacity>> bend;
  std::vector<Lever<capacity>> lever;
  std::vector<LinkVector> link_vector;
  ClosedForm closed;
  double reach = 1.0;
};

// ------------------------------------------------------------------ many poses

template <class S>
S gathered(const double* from, Py_ssize_t stride, Py_ssize_t first, Py_ssize_t n);
template <>
inline double gathered<double>(const double* from, Py_ssize_t stride, Py_ssize_t first, Py_ssize_t) {
  return from[first * stride];
}
inline void scatter(const double& x, double* to, Py_ssize_t stride, Py_ssize_t first, Py_ssize_t) { to[first * stride] = x; }
template <class S>
constexpr Py_ssize_t side_by_side = 1;
#if defined(__GNUC__)
template <>
inline Lanes gathered<Lanes>(const double* from, Py_ssize_t stride, Py_ssize_t first, Py_ssize_t n) {
  Lanes out;
  for (Py_ssize_t k = 0; k < irbcal::width; ++k) out[k] = from[(first + (k < n ? k : n - 1)) * stride];
  return out;
}
inline void scatter(const Lanes& x, double* to, Py_ssize_t stride, Py_ssize_t first, Py_ssize_t n) {
  for (Py_ssize_t k = 0; k < n; ++k) to[(first + k) * stride] = x[k];
}
template <>
constexpr Py_ssize_t side_by_side<Lanes> = irbcal::width;
#endif

template <class S>
inline void poses_of(const Robot& r, const double* q, const double* before, double* out, Py_ssize_t n) {
  constexpr Py_ssize_t together = side_by_side<S>;
  const int joints = r.joints;
  for (Py_ssize_t first = 0; first < n; first += together) {
    const Py_ssize_t count = n - first < together ? n - first : together;
    S x[Robot::capacity], theta[Robot::capacity];
    for (int i = 0; i < joints; ++i) x[i] = gathered<S>(q + i, joints, first, count);
    const Frame<S> tip = forward<false>(r, x, before == nullptr ? nullptr : before + first * joints, theta,
                                        static_cast<S(*)[Robot::capacity]>(nullptr), static_cast<Frame<S>*>(nullptr));
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) scatter(tip.R[j][i], out + 4 * i + j, 16, first, count);
      scatter(tip.o[i], out + 4 * i + 3, 16, first, count);
    }
    for (Py_ssize_t k = first; k < first + count; ++k) {
      double* last = out + 16 * k + 12;
      last[0] = last[1] = last[2] = 0.0;
      last[3] = 1.0;
    }
  }
}

template <class S>
inline void effective_of(const Robot& r, const double* q, const double* before, double* out, Py_ssize_t n) {
  constexpr Py_ssize_t together = side_by_side<S>;
  const int joints = r.joints;
  for (Py_ssize_t first = 0; first < n; first += together) {
    const Py_ssize_t count = n - first < together ? n - first : together;
    S x[Robot::capacity], c[Robot::capacity], s[Robot::capacity], f[Robot::capacity];
    for (int i = 0; i < joints; ++i) x[i] = gathered<S>(q + i, joints, first, count);
    shift<false>(r, x, before == nullptr ? nullptr : before + first * joints, c, s, f,
                 static_cast<S(*)[Robot::capacity]>(nullptr));
    for (int i = 0; i < joints; ++i) scatter(x[i] + f[i], out + i, joints, first, count);
  }
}

template <class S>
inline void jacobians_of(const Robot& r, const double* q, const double* before, int reference, double* out, Py_ssize_t n) {
  constexpr Py_ssize_t together = side_by_side<S>;
  const int joints = r.joints;
  for (Py_ssize_t first = 0; first < n; first += together) {
    const Py_ssize_t count = n - first < together ? n - first : together;
    S x[Robot::capacity], J[6][Robot::capacity];
    for (int i = 0; i < joints; ++i) x[i] = gathered<S>(q + i, joints, first, count);
    const Frame<S> tip = with_jacobian(r, x, before == nullptr ? nullptr : before + first * joints, J);
    for (int j = 0; j < joints; ++j) {
      Vector<S> linear{ {J[0][j], J[1][j], J[2][j]} }, angular{ {J[3][j], J[4][j], J[5][j]} };
      if (reference == 1) {  // along the tip's own axes
        linear = { {dot(tip.R[0], linear), dot(tip.R[1], linear), dot(tip.R[2], linear)} };
        angular = { {dot(tip.R[0], angular), dot(tip.R[1], angular), dot(tip.R[2], angular)} };
      } else if (reference == 2) {  // of the point of the body that passes the origin
        const Vector<S> more = cross(tip.o, angular);
        for (int k = 0; k < 3; ++k) linear[k] += more[k];
      }
      for (int k = 0; k < 3; ++k) {
        scatter(linear[k], out + k * joints + j, 6 * joints, first, count);
        scatter(angular[k], out + (k + 3) * joints + j, 6 * joints, first, count);
      }
    }
  }
}

template <class S>
inline Frame<S> frame_of(const double* T, Py_ssize_t first, Py_ssize_t count) {
  Frame<S> out;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) out.R[j][i] = gathered<S>(T + 4 * i + j, 16, first, count);
    out.o[i] = gathered<S>(T + 4 * i + 3, 16, first, count);
  }
  return out;
}

// Whether the last rows of poses are 0, 0, 0, 1.
template <class S>
inline auto last_row(const double* T, Py_ssize_t first, Py_ssize_t count, const S&) {
  S off = S{};
  for (int j = 0; j < 4; ++j) off += magnitude(gathered<S>(T + 12 + j, 16, first, count) - (j < 3 ? 0.0 : 1.0));
  return off <= 1e-6;
}

struct Wanted {  // arrays of poses and what becomes of them
  const double *T, *signs, *near;  // (n, 4, 4); (n, 3) or null: those of near, else all 1; (n, 6) or null
  double position, rotation;
  double *q, *found;  // (n, 6), and (n, of_a_pose)
};
// Errors of position and rotation, margin, steps, branch asked for, branch found, and 1 where it is within tolerances and
// limits, from a seed within all bounds, for what is a pose: nothing is left to be done there.
constexpr int of_a_pose = 7;

template <class S>
inline void inverses_of(const Robot& r, const Wanted& w, Py_ssize_t n) {
  constexpr Py_ssize_t together = side_by_side<S>;
  for (Py_ssize_t first = 0; first < n; first += together) {
    const Py_ssize_t count = n - first < together ? n - first : together;
    S signs[3], near[6], there[3];
    const Frame<S> wanted = frame_of<S>(w.T, first, count);
    auto done = rigid(wanted) & last_row(w.T, first, count, S{});
    if (w.near != nullptr)
      for (int i = 0; i < 6; ++i) {
        near[i] = gathered<S>(w.near + i, 6, first, count);
        done = done & (magnitude(near[i]) <= r.far[i]) & (magnitude(near[i]) < infinity);
      }
    for (int i = 0; i < 3; ++i) signs[i] = w.signs == nullptr ? all<S>(1.0) : gathered<S>(w.signs + i, 3, first, count);
    if (w.signs == nullptr && w.near != nullptr) branch_signs(r.closed, near, signs);
    const Solution<S> out =
        fixed_point(r, r.closed, wanted, signs, w.near == nullptr ? nullptr : near, r.reach, w.position, w.rotation);
    branch_signs(r.closed, out.q, there);
    done = done & (out.position <= w.position) & (out.rotation <= w.rotation);
    for (int i = 0; i < 6; ++i) {
      done = done & (out.q[i] >= r.lower[i] - limit_tolerance) & (out.q[i] <= r.upper[i] + limit_tolerance);
      scatter(out.q[i], w.q + i, 6, first, count);
    }
    const auto number = [](const S* s) { return 0.5 * (7.0 - 4.0 * s[0] - 2.0 * s[1] - s[2]); };
    const S found[of_a_pose] = {out.position, out.rotation,  out.margin, out.steps, number(signs),
                                number(there), done ? all<S>(1.0) : S{}};
    for (int i = 0; i < of_a_pose; ++i) scatter(found[i], w.found + i, of_a_pose, first, count);
  }
}

template <class S>
inline void branches_of(const Robot& r, const double* T, double* q, double* found, Py_ssize_t n) {
  constexpr Py_ssize_t together = side_by_side<S>;
  for (Py_ssize_t first = 0; first < n; first += together) {
    const Py_ssize_t count = n - first < together ? n - first : together;
    const Frame<S> wanted = frame_of<S>(T, first, count);
    Hand<S> hand = hand_of(r.closed, wanted);
    const auto pose = rigid(wanted) & last_row(T, first, count, S{});
    const S off = pose ? S{} : all<S>(not_a_number);
    hand.radius += off;
    scatter(hand.radius, found, 1, first, count);
    for (int b = 0; b < 8; b += 2) {
      const S front = all<S>(b & 4 ? -1.0 : 1.0);
      S x[6], c23, s23, angle[3];
      const S margin = elbow(r.closed, hand, front, all<S>(b & 2 ? -1.0 : 1.0), x, c23, s23);
      const S lost = margin >= -reach_tolerance ? S{} : all<S>(not_a_number);
      wrist(hand, front, c23, s23, angle);
      x[0] = joint_of(r.closed, 0, arc(hand.s1 * front, hand.c1 * front));
      for (int flip = 0; flip < 2; ++flip) {
        wrist_joints(r.closed, angle, all<S>(flip ? -1.0 : 1.0), x);
        for (int i = 0; i < 6; ++i) scatter(x[i] + lost, q + (6 * (b + flip) + i) * n, 1, first, count);
      }
      if ((b & 2) == 0) scatter(margin, found + (1 + b / 4) * n, 1, first, count);
    }
  }
}

// Four poses side by side where the processor adds four doubles at once; the few one by one.
#if defined(SIDE_BY_SIDE)
const bool wide = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
SIDE_BY_SIDE void poses_together(const Robot& r, const double* q, double* out, Py_ssize_t n) {
  poses_of<Lanes>(r, q, nullptr, out, n);
}
SIDE_BY_SIDE void effective_together(const Robot& r, const double* q, double* out, Py_ssize_t n) {
  effective_of<Lanes>(r, q, nullptr, out, n);
}
SIDE_BY_SIDE void jacobians_together(const Robot& r, const double* q, int reference, double* out, Py_ssize_t n) {
  jacobians_of<Lanes>(r, q, nullptr, reference, out, n);
}
SIDE_BY_SIDE void inverses_together(const Robot& r, const Wanted& w, Py_ssize_t n) { inverses_of<Lanes>(r, w, n); }
SIDE_BY_SIDE void branches_together(const Robot& r, const double* T, double* q, double* found, Py_ssize_t n) {
  branches_of<Lanes>(r, T, q, found, n);
}
#define TOGETHER(function, condition, ...) \
  if (wide && n >= few && (condition)) return function##_together(__VA_ARGS__)
#else
#define TOGETHER(function, condition, ...)
#endif

void poses(const Robot& r, const double* q, const double* before, double* out, Py_ssize_t n) {
  TOGETHER(poses, before == nullptr, r, q, out, n);
  poses_of<double>(r, q, before, out, n);
}
void effective(const Robot& r, const double* q, const double* before, double* out, Py_ssize_t n) {
  TOGETHER(effective, before == nullptr, r, q, out, n);
  effective_of<double>(r, q, before, out, n);
}
void jacobians(const Robot& r, const double* q, const double* before, int reference, double* out, Py_ssize_t n) {
  TOGETHER(jacobians, before == nullptr, r, q, reference, out, n);
  jacobians_of<double>(r, q, before, reference, out, n);
}
void inverses(const Robot& r, const Wanted& w, Py_ssize_t n) {
  TOGETHER(inverses, true, r, w, n);
  inverses_of<double>(r, w, n);
}
void branches(const Robot& r, const double* T, double* q, double* found, Py_ssize_t n) {
  TOGETHER(branches, true, r, T, q, found, n);
  branches_of<double>(r, T, q, found, n);
}

// ------------------------------------------------------------------ arrays from Python

class Array {  // a row-major array of doubles, as long as this lives
 public:
  Array() = default;
  Array(const Array&) = delete;
  Array& operator=(const Array&) = delete;
  ~Array() {
    if (open_) PyBuffer_Release(&view_);
  }
  // False where it is none; no exception is left.
  bool take(PyObject* object, bool writable = false) {
    open_ = PyObject_GetBuffer(object, &view_, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0)) == 0;
    if (!open_) PyErr_Clear();
    return open_ && view_.format != nullptr && view_.format[0] == 'd' && view_.format[1] == 0;
  }
  double* data() const { return static_cast<double*>(view_.buf); }
  Py_ssize_t size() const { return view_.len / 8; }
  bool is(Py_ssize_t rows, Py_ssize_t columns) const {
    return view_.ndim == 2 && view_.shape[0] == rows && view_.shape[1] == columns;
  }
  Py_ssize_t rows() const { return view_.ndim > 0 ? view_.shape[0] : 0; }

 private:
  Py_buffer view_;
  bool open_ = false;
};

struct Kernel {
  PyObject_HEAD
  Robot* robot;
  PyObject* numbers;  // the dict that it was made of
};

struct Joints {  // arguments (q, before or None, ..., out)
  Array q, before, out;
  const double* previous = nullptr;
  // False where these are not (n, joints) doubles, the output has another size, or, checked, a number is beyond all bounds.
  bool take(const Robot& r, PyObject* q_object, PyObject* before_object, bool checked, PyObject* out_object,
            Py_ssize_t per_pose) {
    if (!q.take(q_object) || !q.is(q.rows(), r.joints) || !out.take(out_object, true)) return false;
    if (out.size() != q.rows() * per_pose) return false;
    if (before_object != Py_None) {
      if (!before.take(before_object) || !before.is(q.rows(), r.joints)) return false;
      previous = before.data();
    }
    const double* x = q.data();
    for (Py_ssize_t k = 0; checked && k < q.size(); k += r.joints)
      for (int i = 0; i < r.joints; ++i)
        if (std::abs(x[k + i]) > r.far[i]) return false;
    return true;
  }
};

bool count_is(Py_ssize_t found, Py_ssize_t wanted) {
  if (found == wanted) return true;
  PyErr_Format(PyExc_TypeError, "expected %zd arguments, found %zd", wanted, found);
  return false;
}

template <class Work>
void unlocked(Py_ssize_t n, Work work) {
  if (n < worth_unlocking) {
    work();
    return;
  }
  Py_BEGIN_ALLOW_THREADS;
  work();
  Py_END_ALLOW_THREADS;
}

PyObject* kernel_poses(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 4)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  Joints a;
  if (!a.take(r, args[0], args[1], args[2] == Py_True, args[3], 16)) Py_RETURN_FALSE;
  unlocked(a.q.rows(), [&] { poses(r, a.q.data(), a.previous, a.out.data(), a.q.rows()); });
  Py_RETURN_TRUE;
}

PyObject* kernel_effective(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 3)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  Joints a;
  if (!a.take(r, args[0], args[1], false, args[2], r.joints)) Py_RETURN_FALSE;
  unlocked(a.q.rows(), [&] { effective(r, a.q.data(), a.previous, a.out.data(), a.q.rows()); });
  Py_RETURN_TRUE;
}

PyObject* kernel_jacobians(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 4)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  const long reference = PyLong_AsLong(args[2]);
  if (reference == -1 && PyErr_Occurred()) return nullptr;
  Joints a;
  if (!a.take(r, args[0], args[1], true, args[3], 6 * r.joints)) Py_RETURN_FALSE;
  unlocked(a.q.rows(), [&] {
    jacobians(r, a.q.data(), a.previous, static_cast<int>(reference), a.out.data(), a.q.rows());
  });
  Py_RETURN_TRUE;
}

PyObject* kernel_inverses(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 7)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  Array T, signs, near, q, found;
  Wanted w{};
  w.position = PyFloat_AsDouble(args[3]);
  w.rotation = PyFloat_AsDouble(args[4]);
  if (PyErr_Occurred()) return nullptr;
  if (!r.has_closed_form || !T.take(args[0]) || !q.take(args[5], true) || !found.take(args[6], true)) Py_RETURN_FALSE;
  const Py_ssize_t n = T.rows();
  if (T.size() != 16 * n || !q.is(n, 6) || !found.is(n, of_a_pose)) Py_RETURN_FALSE;
  if (args[1] != Py_None) {
    if (!signs.take(args[1]) || !signs.is(n, 3)) Py_RETURN_FALSE;
    w.signs = signs.data();
  }
  if (args[2] != Py_None) {
    if (!near.take(args[2]) || !near.is(n, 6)) Py_RETURN_FALSE;
    w.near = near.data();
  }
  w.T = T.data();
  w.q = q.data();
  w.found = found.data();
  unlocked(n, [&] { inverses(r, w, n); });
  Py_RETURN_TRUE;
}

PyObject* kernel_branches(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 3)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  Array T, q, found;
  if (!r.has_closed_form || !T.take(args[0]) || !q.take(args[1], true) || !found.take(args[2], true)) Py_RETURN_FALSE;
  const Py_ssize_t n = T.rows();
  if (T.size() != 16 * n || q.size() != 48 * n || found.size() != 3 * n) Py_RETURN_FALSE;
  unlocked(n, [&] { branches(r, T.data(), q.data(), found.data(), n); });
  Py_RETURN_TRUE;
}

PyObject* kernel_newton(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 9)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  Array T, q, limits, found;
  Steps steps{};
  const double reach = PyFloat_AsDouble(args[2]);
  steps.position = PyFloat_AsDouble(args[3]);
  steps.rotation = PyFloat_AsDouble(args[4]);
  steps.straighten = static_cast<int>(PyLong_AsLong(args[5]));
  steps.patience = static_cast<int>(PyLong_AsLong(args[6]));
  if (PyErr_Occurred()) return nullptr;
  if (!T.take(args[0]) || !q.take(args[1], true) || !found.take(args[8], true)) Py_RETURN_FALSE;
  const Py_ssize_t n = T.rows();
  if (T.size() != 16 * n || !q.is(n, r.joints) || !found.is(n, 3)) Py_RETURN_FALSE;
  if (args[7] != Py_None) {
    if (!limits.take(args[7]) || !limits.is(2, r.joints)) Py_RETURN_FALSE;
    steps.lower = limits.data();
    steps.upper = limits.data() + r.joints;
  }
  unlocked(n, [&] {
    for (Py_ssize_t k = 0; k < n; ++k) {
      double* row = found.data() + 3 * k;
      row[2] = newton(r, frame_of<double>(T.data(), k, 1), reach, steps, q.data() + k * r.joints, row[0], row[1]);
    }
  });
  Py_RETURN_TRUE;
}

// ------------------------------------------------------------------ a robot from a dict of arrays

// The numbers of a name; empty where there is none. False, with an exception, where they are no doubles or of a wrong size.
bool numbers(PyObject* dict, const char* name, std::vector<double>& out, Py_ssize_t size, Py_ssize_t rows = -1) {
  out.clear();
  PyObject* value = PyDict_GetItemString(dict, name);
  if (value == nullptr) return true;
  Array array;
  if (!array.take(value) || (rows < 0 ? array.size() != size : array.size() % size != 0)) {
    PyErr_Format(PyExc_ValueError, "%s: expected an array of doubles, %zd for each", name, size);
    return false;
  }
  out.assign(array.data(), array.data() + array.size());
  return true;
}

void to_chain(const std::vector<double>& from, int joints, Constant* chain, Constant& tip) {
  for (int i = 0; i <= joints; ++i) {
    Constant& C = i < joints ? chain[i] : tip;
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 4; ++k) (k < 3 ? C.R[j][k] : C.p[j]) = from[static_cast<std::size_t>(12 * i + 4 * j + k)];
  }
}

bool fill(Robot& r, PyObject* dict) {
  std::vector<double> v;
  if (!numbers(dict, "slides", v, 1, 0)) return false;
  if (v.empty() || v.size() > most_joints) {
    PyErr_Format(PyExc_ValueError, "slides: expected 1 to %d joints", most_joints);
    return false;
  }
  const int n = r.joints = static_cast<int>(v.size());
  for (int i = 0; i < n; ++i) {
    const std::size_t at = static_cast<std::size_t>(i);
    r.slides[i] = v[at] != 0.0;
    r.far[i] = r.upper[i] = infinity;
    r.lower[i] = -infinity;
    r.width[i] = 1.0;
  }
  struct { const char* name; double* to; Py_ssize_t size; } const plain[] = {
      {"far", r.far, n}, {"lower", r.lower, n}, {"upper", r.upper, n}, {"gravity", r.gravity, 3}, {"payload_kg", &r.payload_kg, 1},
      {"payload_place", r.payload_place, 3}, {"gain", r.gain, n}, {"offset", r.offset, n}, {"compliance", r.compliance, n},
      {"direction", r.direction, n}, {"width", r.width, n}, {"move", r.move, n}, {"share", r.share, n}, {"reach", &r.reach, 1}};
  for (const auto& item : plain) {
    if (!numbers(dict, item.name, v, item.size)) return false;
    std::copy(v.begin(), v.end(), item.to);
  }
  if (!numbers(dict, "chain", v, 12 * (n + 1))) return false;
  if (v.empty()) {
    PyErr_SetString(PyExc_ValueError, "chain: there is none");
    return false;
  }
  to_chain(v, n, r.chain, r.tip);
  if (!numbers(dict, "nominal", v, 12 * (n + 1))) return false;
  if (!v.empty()) to_chain(v, n, r.nominal, r.nominal_tip);
  r.has_map = !v.empty();
  if (!numbers(dict, "cosine", v, n, 0)) return false;
  if (v.size() > static_cast<std::size_t>(n * most_orders) || (v.size() / static_cast<std::size_t>(n)) % 2 != 0) {
    PyErr_SetString(PyExc_ValueError, "cosine: expected an even number of orders");
    return false;
  }
  r.orders = static_cast<int>(v.size()) / n;
  for (std::size_t k = 0; k < v.size(); ++k) r.cosine[k / static_cast<std::size_t>(n)][k % static_cast<std::size_t>(n)] = v[k];
  if (!numbers(dict, "sine", v, n, 0)) return false;
  if (v.size() != static_cast<std::size_t>(n * r.orders)) {
    PyErr_SetString(PyExc_ValueError, "sine: expected as many orders as cosine");
    return false;
  }
  for (std::size_t k = 0; k < v.size(); ++k)
    r.sine[k / static_cast<std::size_t>(n)][k % static_cast<std::size_t>(n)] = v[k];
  if (!numbers(dict, "waves", v, 4, 0)) return false;
  for (std::size_t k = 0; k < v.size(); k += 4) r.wave.push_back({static_cast<int>(v[k]), v[k + 1], v[k + 2], v[k + 3]});
  const std::size_t joints = static_cast<std::size_t>(n);
  if (!numbers(dict, "bends", v, 2 + 2 * n, 0)) return false;
  for (std::size_t k = 0; k < v.size(); k += 2 + 2 * joints) {
    Bend<Robot::capacity> bend{v[k], v[k + 1], {}, {}};
    for (std::size_t i = 0; i < joints; ++i) {
      bend.of[i] = v[k + 2 + i] != 0.0;
      bend.to[i] = v[k + 2 + joints + i] != 0.0;
    }
    r.bend.push_back(bend);
  }
  if (!numbers(dict, "link_vectors", v, 4, 0)) return false;
  for (std::size_t k = 0; k < v.size(); k += 4) r.link_vector.push_back({static_cast<int>(v[k]), {v[k + 1], v[k + 2], v[k + 3]}});
  if (!numbers(dict, "levers", v, 3 + n, 0)) return false;
  for (std::size_t k = 0; k < v.size(); k += 3 + joints) {
    Lever<Robot::capacity> lever{static_cast<int>(v[k]), static_cast<int>(v[k + 1]), static_cast<int>(v[k + 2]), {}};
    for (std::size_t i = 0; i < joints; ++i) lever.to[i] = v[k + 3 + i] != 0.0;
    r.lever.push_back(lever);
  }
  bool within = true;
  for (const Wave& item : r.wave) within = within && item.joint >= 0 && item.joint < n;
  for (const LinkVector& item : r.link_vector) within = within && item.link >= 0 && item.link < n;
  for (const auto& item : r.lever)
    within = within && item.joint >= 0 && item.joint < n && item.first >= 0 &&
             item.last < static_cast<int>(r.link_vector.size());
  if (!within) {
    PyErr_SetString(PyExc_ValueError, "a joint, link or vector is none of the robot's");
    return false;
  }
  r.waves = static_cast<int>(r.wave.size());
  r.bends = static_cast<int>(r.bend.size());
  r.levers = static_cast<int>(r.lever.size());
  for (int i = 0; i < n; ++i) {
    r.has_payload = r.has_payload || r.compliance[i] != 0.0;
    r.has_history = r.has_history || r.direction[i] != 0.0 || r.move[i] != 0.0 || r.share[i] != 0.0;
  }
  if (!numbers(dict, "closed_form", v, 5 + 12 + 24)) return false;
  if (!v.empty()) {
    if (n != 6) {
      PyErr_SetString(PyExc_ValueError, "closed_form: expected six joints");
      return false;
    }
    r.has_closed_form = true;
    ClosedForm& c = r.closed;
    c.a2 = v[0], c.a3 = v[1], c.d4 = v[2], c.a4 = v[3], c.bend = v[4];
    std::copy(v.begin() + 5, v.begin() + 11, c.signs);
    std::copy(v.begin() + 11, v.begin() + 17, c.shifts);
    const std::vector<double> frames(v.begin() + 17, v.end());
    to_chain(frames, 1, &c.left, c.right);
  }
  return true;
}

PyObject* kernel_new(PyTypeObject* type, PyObject* args, PyObject*) {
  PyObject* dict = nullptr;
  if (!PyArg_ParseTuple(args, "O!", &PyDict_Type, &dict)) return nullptr;
  auto allocate = reinterpret_cast<allocfunc>(PyType_GetSlot(type, Py_tp_alloc));
  PyObject* self = allocate(type, 0);
  if (self == nullptr) return nullptr;
  Kernel* kernel = reinterpret_cast<Kernel*>(self);
  Py_INCREF(dict);
  kernel->numbers = dict;
  kernel->robot = new (std::nothrow) Robot;
  if (kernel->robot == nullptr) {
    Py_DECREF(self);
    return PyErr_NoMemory();
  }
  bool good = false;
  try {
    good = fill(*kernel->robot, dict);
  } catch (const std::bad_alloc&) {
    PyErr_NoMemory();
  }
  if (!good) {
    Py_DECREF(self);
    return nullptr;
  }
  return self;
}

// Pickled as the numbers that it was made of: elsewhere there may be no compiled kernel.
PyObject* kernel_reduce(PyObject* self, PyObject*) {
  PyObject* package = PyImport_ImportModule("irbcal.kernel");
  if (package == nullptr) return nullptr;
  PyObject* made = PyObject_GetAttrString(package, "made");
  Py_DECREF(package);
  return made == nullptr ? nullptr : Py_BuildValue("(N(O))", made, reinterpret_cast<Kernel*>(self)->numbers);
}

void kernel_free(PyObject* self) {
  PyTypeObject* type = Py_TYPE(self);
  delete reinterpret_cast<Kernel*>(self)->robot;
  Py_XDECREF(reinterpret_cast<Kernel*>(self)->numbers);
  reinterpret_cast<freefunc>(PyType_GetSlot(type, Py_tp_free))(self);
  Py_DECREF(type);
}

template <class Function>
constexpr PyCFunction method(Function function) {
  return reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(function));
}

PyMethodDef methods[] = {
    {"__reduce__", kernel_reduce, METH_NOARGS, "How it is pickled."},
    {"poses", method(kernel_poses), METH_FASTCALL, "poses(q, before, checked, out): (n, 4, 4); False where refused"},
    {"effective", method(kernel_effective), METH_FASTCALL, "effective(q, before, out): effective joints (n, joints)"},
    {"jacobians", method(kernel_jacobians), METH_FASTCALL, "jacobians(q, before, reference, out): (n, 6, joints)"},
    {"inverses", method(kernel_inverses), METH_FASTCALL,
     "inverses(T, signs, near, position, rotation, q, found): found as in binding.cpp (n, 7)"},
    {"newton", method(kernel_newton), METH_FASTCALL,
     "newton(T, q, reach, position, rotation, straighten, patience, limits, found): q in place; errors, evaluations (n, 3)"},
    {"branches", method(kernel_branches), METH_FASTCALL, "branches(T, q, found): (8, 6, n); radius, margins (3, n)"},
    {nullptr, nullptr, 0, nullptr}};

PyType_Slot slots[] = {{Py_tp_new, reinterpret_cast<void*>(kernel_new)},
                       {Py_tp_dealloc, reinterpret_cast<void*>(kernel_free)},
                       {Py_tp_methods, methods},
                       {0, nullptr}};
PyType_Spec spec = {"irbcal.kernel.compiled.Kernel", sizeof(Kernel), 0, Py_TPFLAGS_DEFAULT, slots};

int on_import(PyObject* module) {
  PyObject* type = PyType_FromSpec(&spec);
  if (type == nullptr) return -1;
  if (PyModule_AddObject(module, "Kernel", type) < 0) {
    Py_DECREF(type);
    return -1;
  }
  return PyModule_AddStringConstant(module, "sources", IRBCAL_SOURCES);
}

PyModuleDef_Slot module_slots[] = {{Py_mod_exec, reinterpret_cast<void*>(on_import)}, {0, nullptr}};
PyModuleDef module = {PyModuleDef_HEAD_INIT, "compiled", "The compiled kernel.", 0, nullptr, module_slots, nullptr, nullptr, nullptr};

}  // namespace

PyMODINIT_FUNC PyInit_compiled() { return PyModuleDef_Init(&module); }
