// kernel.hpp for Python: one class, Kernel, whose methods read and write arrays of doubles that numpy made.
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <new>
#include <vector>

#if defined(__x86_64__) && defined(__GNUC__)
#define IRBCAL_LANES
#define SIDE_BY_SIDE __attribute__((target("avx2,fma"), flatten))
#endif

#include "kernel.hpp"
#include "motion.hpp"

namespace {

using namespace irbcal;

constexpr int most_joints = 12, most_orders = 128;
constexpr Py_ssize_t few = 4, worth_unlocking = 64;

struct Robot {
  static constexpr int capacity = most_joints;
  static constexpr bool has_frames = true;
  int joints = 0, depth = 0, orders = 0, waves = 0, bends = 0, levers = 0, tiltings = 0, bendings = 0;
  bool has_map = false, has_payload = false, has_torques = false, has_history = false, has_closed_form = false;
  bool moves_frames = false;
  bool slides[capacity] = {};
  double far[capacity], lower[capacity], upper[capacity];
  Constant chain[capacity], nominal[capacity], tip, nominal_tip;
  double gravity[3] = {}, payload_kg = 0.0, payload_centre[3] = {};
  double gain[capacity] = {}, offset[capacity] = {}, compliance[capacity] = {}, torque[capacity] = {};
  double direction[capacity] = {}, width[capacity], move[capacity] = {}, share[capacity] = {}, along[capacity] = {};
  double stride[capacity];
  double cosine[most_orders][capacity] = {}, sine[most_orders][capacity] = {};
  std::vector<Wave> wave;
  std::vector<Bend<capacity>> bend;
  std::vector<Lever<capacity>> lever;
  std::vector<LinkVector> link_vector;
  std::vector<Tilting> tilting;
  std::vector<Bending> bending;
  ClosedForm closed;
  double reach = 1.0, difference = 0.0, starts[6 * starts_of_all] = {};
};

// Cosines, then sines (2, n), of angles.
template <class S>
inline void cos_sin_of(const double* x, double* out, std::ptrdiff_t n) noexcept {
  constexpr std::ptrdiff_t together = side_by_side<S>;
  for (std::ptrdiff_t first = 0; first < n; first += together) {
    const std::ptrdiff_t count = n - first < together ? n - first : together;
    S sine, cosine;
    if (count < together) {
      sine_cosine(gathered<S>(x, 1, first, count), sine, cosine);
      scatter(cosine, out, 1, first, count);
      scatter(sine, out + n, 1, first, count);
      return;
    }
    S angle;
    std::memcpy(&angle, x + first, sizeof(S));
    sine_cosine(angle, sine, cosine);
    std::memcpy(out + first, &cosine, sizeof(S));
    std::memcpy(out + n + first, &sine, sizeof(S));
  }
}

// Four poses side by side where the processor adds four doubles at once; the few one by one.
#if defined(SIDE_BY_SIDE)
const bool wide = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
SIDE_BY_SIDE void poses_together(const Robot& r, const double* q, double* out, Py_ssize_t n) {
  poses_of<Lanes>(r, q, Stops{}, out, n);
}
SIDE_BY_SIDE void effective_together(const Robot& r, const double* q, double* out, Py_ssize_t n) {
  effective_of<Lanes>(r, q, Stops{}, out, n);
}
SIDE_BY_SIDE void jacobians_together(const Robot& r, const double* q, int reference, double* out, Py_ssize_t n) {
  jacobians_of<Lanes>(r, q, Stops{}, reference, out, n);
}
SIDE_BY_SIDE void cos_sin_together(const double* x, double* out, Py_ssize_t n) { cos_sin_of<Lanes>(x, out, n); }
SIDE_BY_SIDE void inverses_together(const Robot& r, const Wanted& w, Py_ssize_t n) { inverses_of<Lanes>(r, w, n); }
SIDE_BY_SIDE void branches_together(const Robot& r, const double* T, double* out, bool* valid, Py_ssize_t n) {
  branches_of<Lanes>(r, T, out, valid, n);
}
#define TOGETHER(function, condition, ...) \
  if (wide && (condition)) return function##_together(__VA_ARGS__)
#else
#define TOGETHER(function, condition, ...)
#endif

void poses(const Robot& r, const double* q, const Stops& stops, double* out, Py_ssize_t n) {
  TOGETHER(poses, n >= few && !stops.known(), r, q, out, n);
  poses_of<double>(r, q, stops, out, n);
}
void effectives(const Robot& r, const double* q, const Stops& stops, double* out, Py_ssize_t n) {
  TOGETHER(effective, n >= few && !stops.known(), r, q, out, n);
  effective_of<double>(r, q, stops, out, n);
}
void jacobians(const Robot& r, const double* q, const Stops& stops, int reference, double* out, Py_ssize_t n) {
  TOGETHER(jacobians, n >= few && !stops.known(), r, q, reference, out, n);
  jacobians_of<double>(r, q, stops, reference, out, n);
}
void cos_sin(const double* x, double* out, Py_ssize_t n) {
  TOGETHER(cos_sin, n >= few, x, out, n);
  cos_sin_of<double>(x, out, n);
}
void inverses(const Robot& r, const Wanted& w, Py_ssize_t n) {
  TOGETHER(inverses, n >= few, r, w, n);
  inverses_of<double>(r, w, n);
}
void branches(const Robot& r, const double* T, double* out, bool* valid, Py_ssize_t n) {
  TOGETHER(branches, true, r, T, out, valid, n);
  branches_of<double>(r, T, out, valid, n);
}

// ------------------------------------------------------------------ arrays from Python

class Array {  // a row-major array of doubles, or of another type by its letters, as long as this lives
 public:
  Array() = default;
  Array(const Array&) = delete;
  Array& operator=(const Array&) = delete;
  ~Array() {
    if (open_) PyBuffer_Release(&view_);
  }
  // False where it is none; no exception is left.
  bool take(PyObject* object, bool writable = false, const char* type = "d") {
    open_ = PyObject_GetBuffer(object, &view_, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0)) == 0;
    if (!open_) PyErr_Clear();
    return open_ && view_.format != nullptr && view_.format[0] != 0 && view_.format[1] == 0 &&
           std::strchr(type, view_.format[0]) != nullptr;
  }
  template <class T = double>
  T* data() const { return static_cast<T*>(view_.buf); }
  Py_ssize_t size() const { return view_.len / view_.itemsize; }
  bool is(Py_ssize_t rows, Py_ssize_t columns) const {
    return view_.ndim == 2 && view_.shape[0] == rows && view_.shape[1] == columns;
  }
  bool are_poses() const { return view_.ndim == 3 && view_.shape[1] == 4 && view_.shape[2] == 4; }
  Py_ssize_t bytes() const { return view_.itemsize; }
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

// Arguments (q, stops, ..., out). stops: None, or a tuple of the stops before, masses, places and torques, or None for each.
struct Joints {
  Array q, out, known[4];
  Stops stops;
  // False where these are not (n, joints) doubles, the output has another size, or, checked, a number is beyond all bounds.
  bool take(const Robot& r, PyObject* q_object, PyObject* stops_object, bool checked, PyObject* out_object,
            Py_ssize_t per_pose) {
    const Py_ssize_t n = q.take(q_object) ? q.rows() : -1;
    if (n < 0 || !q.is(n, r.joints) || !out.take(out_object, true) || out.size() != n * per_pose) return false;
    if (stops_object != Py_None) {
      if (!PyTuple_Check(stops_object) || PyTuple_Size(stops_object) != 4) return false;
      const double** const to[4] = {&stops.before, &stops.payload_kg, &stops.payload_centre, &stops.torques};
      const Py_ssize_t sizes[4] = {n * r.joints, n, 3 * n, n * r.joints};
      for (Py_ssize_t k = 0; k < 4; ++k) {
        PyObject* const item = PyTuple_GetItem(stops_object, k);
        if (item == Py_None) continue;
        if (!known[k].take(item) || known[k].size() != sizes[k]) return false;
        *to[k] = known[k].data();
      }
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
  unlocked(a.q.rows(), [&] { poses(r, a.q.data(), a.stops, a.out.data(), a.q.rows()); });
  Py_RETURN_TRUE;
}

PyObject* kernel_effective(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 3)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  Joints a;
  if (!a.take(r, args[0], args[1], false, args[2], r.joints)) Py_RETURN_FALSE;
  unlocked(a.q.rows(), [&] { effectives(r, a.q.data(), a.stops, a.out.data(), a.q.rows()); });
  Py_RETURN_TRUE;
}

PyObject* cos_sin_of_angles(PyObject*, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 2)) return nullptr;
  Array x, out;
  if (!x.take(args[0]) || !out.take(args[1], true) || out.size() != 2 * x.size()) {
    PyErr_SetString(PyExc_ValueError, "expected rows of doubles, and twice as many for their cosines and sines");
    return nullptr;
  }
  unlocked(x.size(), [&] { cos_sin(x.data(), out.data(), x.size()); });
  Py_RETURN_NONE;
}

PyObject* kernel_map_slopes(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 4)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  Joints a;
  Array dq;
  if (!a.take(r, args[0], args[1], false, args[3], r.joints * r.joints)) Py_RETURN_FALSE;
  if (args[2] != Py_None && (!dq.take(args[2]) || !dq.is(a.q.rows(), r.joints))) Py_RETURN_FALSE;
  const double* const speeds = args[2] == Py_None ? nullptr : dq.data();
  unlocked(a.q.rows(), [&] { map_slopes_of(r, a.q.data(), speeds, a.stops, a.out.data(), a.q.rows()); });
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
    jacobians(r, a.q.data(), a.stops, static_cast<int>(reference), a.out.data(), a.q.rows());
  });
  Py_RETURN_TRUE;
}

PyObject* kernel_rates(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 4)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  const long reference = PyLong_AsLong(args[2]);
  if (reference == -1 && PyErr_Occurred()) return nullptr;
  Joints a;
  Array dq;
  if (!a.take(r, args[0], Py_None, true, args[3], 6 * r.joints)) Py_RETURN_FALSE;
  if (!dq.take(args[1]) || !dq.is(a.q.rows(), r.joints)) Py_RETURN_FALSE;
  unlocked(a.q.rows(), [&] {
    rates_of(r, a.q.data(), dq.data(), static_cast<int>(reference), a.out.data(), a.q.rows());
  });
  Py_RETURN_TRUE;
}

PyObject* kernel_inverses(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 10)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  Array T, signs, near, q, left, whole, flags;
  Wanted w{};
  w.position = PyFloat_AsDouble(args[3]);
  w.rotation = PyFloat_AsDouble(args[4]);
  w.stages = static_cast<int>(std::min(PyLong_AsLong(args[9]), static_cast<long>(most_stages)));
  if (PyErr_Occurred()) return nullptr;
  if (!r.has_closed_form || !T.take(args[0]) || !q.take(args[5], true) || !left.take(args[6], true)) Py_RETURN_FALSE;
  if (!whole.take(args[7], true, "lq") || !flags.take(args[8], true, "?")) Py_RETURN_FALSE;
  const Py_ssize_t n = T.rows();
  if (!T.are_poses() || !q.is(n, 6) || left.size() != 2 * n || flags.size() != 3 * n) Py_RETURN_FALSE;
  if (whole.size() != 4 * n || whole.bytes() != 8) Py_RETURN_FALSE;
  if (args[1] != Py_None) {
    if (!signs.take(args[1]) || !signs.is(n, 3)) Py_RETURN_FALSE;
    w.signs = signs.data();
  }
  if (args[2] != Py_None) {
    if (!near.take(args[2]) || near.size() != 6 * n) Py_RETURN_FALSE;
    w.near = near.data();
    for (Py_ssize_t k = 0; k < near.size(); ++k)
      if (std::abs(w.near[k]) > r.far[k % 6]) Py_RETURN_FALSE;
  }
  w.T = T.data();
  w.q = q.data();
  w.left = left.data();
  w.numbers = whole.data<std::int64_t>();
  w.flags = flags.data<bool>();
  unlocked(n, [&] { inverses(r, w, n); });
  Py_RETURN_TRUE;
}

PyObject* kernel_branches(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 3)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  Array T, out, valid;
  if (!r.has_closed_form || !T.take(args[0]) || !T.are_poses() || !out.take(args[1], true)) Py_RETURN_FALSE;
  const Py_ssize_t n = T.rows();
  if (!valid.take(args[2], true, "?") || valid.size() != 8 * n || out.size() != 51 * n) Py_RETURN_FALSE;
  unlocked(n, [&] { branches(r, T.data(), out.data(), valid.data<bool>(), n); });
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

// ------------------------------------------------------------------ one pose of lists, for live correction

// Numbers of a list; false, with an exception, where it is no list of so many.
bool from_list(PyObject* list, double* out, Py_ssize_t count) {
  if (!PyList_Check(list) || PyList_Size(list) != count) {
    PyErr_Format(PyExc_TypeError, "expected a list of %zd numbers", count);
    return false;
  }
  for (Py_ssize_t k = 0; k < count; ++k) out[k] = PyFloat_AsDouble(PyList_GetItem(list, k));
  return PyErr_Occurred() == nullptr;
}

PyObject* to_list(const double* values, Py_ssize_t count) {
  PyObject* list = PyList_New(count);
  for (Py_ssize_t k = 0; list != nullptr && k < count; ++k) {
    PyObject* value = PyFloat_FromDouble(values[k]);
    if (value == nullptr || PyList_SetItem(list, k, value) != 0) {
      Py_DECREF(list);
      return nullptr;
    }
  }
  return list;
}

template <bool nominal>
PyObject* kernel_tip(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 1)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  double theta[most_joints];
  if (!from_list(args[0], theta, r.joints)) return nullptr;
  const Frame<double> tip = tip_of(r, nominal ? r.nominal : r.chain, nominal ? r.nominal_tip : r.tip, theta);
  PyObject* rows[3] = {};
  for (int i = 0; i < 3; ++i) {
    const double row[4] = {tip.R[0][i], tip.R[1][i], tip.R[2][i], tip.o[i]};
    rows[i] = to_list(row, 4);
  }
  return Py_BuildValue("[NNN]", rows[0], rows[1], rows[2]);
}

PyObject* kernel_nearest(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 5)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  Frame<double> wanted;
  for (int i = 0; i < 3; ++i) {
    double row[4];
    PyObject* list = PyList_Check(args[0]) ? PyList_GetItem(args[0], i) : nullptr;
    if (list == nullptr || !from_list(list, row, 4)) return nullptr;
    for (int j = 0; j < 3; ++j) wanted.R[j][i] = row[j];
    wanted.o[i] = row[3];
  }
  double theta[most_joints], lower[most_joints], upper[most_joints], position = infinity, rotation = infinity;
  const double tolerance = PyFloat_AsDouble(args[2]);
  if (!from_list(args[1], theta, r.joints) || !from_list(args[3], lower, r.joints) || !from_list(args[4], upper, r.joints))
    return nullptr;
  newton(r, wanted, r.reach, Steps{tolerance, tolerance, 0, 10, lower, upper, false}, theta, position, rotation);
  return Py_BuildValue("(Ndd)", to_list(theta, r.joints), position, rotation);
}

PyObject* kernel_settled(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 3)) return nullptr;
  const Robot& r = *reinterpret_cast<Kernel*>(self)->robot;
  double theta[most_joints], moves[most_joints], q[most_joints];
  if (!from_list(args[0], theta, r.joints) || !from_list(args[1], moves, r.joints) || !from_list(args[2], q, r.joints))
    return nullptr;
  if (!settle(r, theta, usual(r), moves, q)) Py_RETURN_NONE;
  return to_list(q, r.joints);
}

struct FollowingArm {
  PyObject_HEAD
  Motion<most_joints> motion;
};

PyObject* motion_new(PyTypeObject* type, PyObject* args, PyObject*) {
  double t = 0.0;
  PyObject* rows = nullptr;
  if (!PyArg_ParseTuple(args, "dO!", &t, &PyList_Type, &rows)) return nullptr;
  const Py_ssize_t n = PyList_Size(rows);
  if (n > most_joints) {
    PyErr_Format(PyExc_ValueError, "expected at most %d joints", most_joints);
    return nullptr;
  }
  auto allocate = reinterpret_cast<allocfunc>(PyType_GetSlot(type, Py_tp_alloc));
  PyObject* self = allocate(type, 0);
  if (self == nullptr) return nullptr;
  Motion<most_joints>& motion = *new (&reinterpret_cast<FollowingArm*>(self)->motion) Motion<most_joints>;
  motion.joints = static_cast<int>(n);
  motion.stood(t);
  for (Py_ssize_t k = 0; k < n; ++k) {
    double v[6];
    if (!from_list(PyList_GetItem(rows, k), v, 6)) {
      Py_DECREF(self);
      return nullptr;
    }
    motion.each[k].begin(v[0], v[1], v[2], v[3], v[4], v[5]);
  }
  return self;
}

PyObject* motion_follow(PyObject* self, PyObject* const* args, Py_ssize_t count) {
  if (!count_is(count, 3)) return nullptr;
  Motion<most_joints>& motion = reinterpret_cast<FollowingArm*>(self)->motion;
  double goal[most_joints], command[most_joints];
  const double t = PyFloat_AsDouble(args[0]);
  if (!from_list(args[1], goal, motion.joints)) return nullptr;
  motion.follow(t, goal, args[2] == Py_True, command);
  return to_list(command, motion.joints);
}

PyObject* motion_rest(PyObject* self, PyObject*) {
  const Motion<most_joints>& motion = reinterpret_cast<FollowingArm*>(self)->motion;
  double rest[most_joints];
  for (int i = 0; i < motion.joints; ++i) rest[i] = motion.each[i].rest();
  return to_list(rest, motion.joints);
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
    r.width[i] = r.stride[i] = 1.0;
  }
  struct { const char* name; double* to; Py_ssize_t size; } const plain[] = {
      {"far", r.far, n}, {"lower", r.lower, n}, {"upper", r.upper, n}, {"gravity", r.gravity, 3}, {"payload_kg", &r.payload_kg, 1},
      {"payload_centre", r.payload_centre, 3}, {"gain", r.gain, n}, {"offset", r.offset, n}, {"compliance", r.compliance, n},
      {"direction", r.direction, n}, {"width", r.width, n}, {"move", r.move, n}, {"share", r.share, n}, {"reach", &r.reach, 1},
      {"torque", r.torque, n}, {"stride", r.stride, n}, {"along", r.along, n}, {"difference", &r.difference, 1},
      {"starts", r.starts, 6 * starts_of_all}};
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
  const bool has_nominal = !v.empty();
  if (!numbers(dict, "depth", v, 1)) return false;
  r.depth = v.empty() ? n : static_cast<int>(v[0]);
  if (!numbers(dict, "gain", v, n)) return false;
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
  if (!numbers(dict, "tiltings", v, 14, 0)) return false;
  for (std::size_t k = 0; k < v.size(); k += 14) {
    Tilting item{static_cast<int>(v[k]), v[k + 1], {}, {}};
    std::copy(&v[k] + 2, &v[k] + 8, item.cosine);
    std::copy(&v[k] + 8, &v[k] + 14, item.sine);
    r.tilting.push_back(item);
  }
  if (!numbers(dict, "bendings", v, 12, 0)) return false;
  for (std::size_t k = 0; k < v.size(); k += 12) {
    Bending item{static_cast<int>(v[k]), static_cast<int>(v[k + 1]), static_cast<int>(v[k + 2]), {}, {}};
    std::copy(&v[k] + 3, &v[k] + 6, item.axis);
    std::copy(&v[k] + 6, &v[k] + 12, item.motion);
    r.bending.push_back(item);
  }
  bool within = r.depth >= 0 && r.depth <= n && (has_nominal || !(r.has_map || r.tilting.size() || r.bending.size()));
  const int vectors = static_cast<int>(r.link_vector.size());
  for (const Tilting& item : r.tilting) within = within && item.joint >= 0 && item.joint < n;
  for (const Bending& item : r.bending)
    within = within && item.joint >= 0 && item.joint < n && item.first >= 0 && item.last < vectors;
  for (const Wave& item : r.wave) within = within && item.joint >= 0 && item.joint < n;
  for (const LinkVector& item : r.link_vector) within = within && item.link >= 0 && item.link < n;
  for (const auto& item : r.lever)
    within = within && item.joint >= 0 && item.joint < n && item.first >= 0 && item.last < vectors;
  if (!within) {
    PyErr_SetString(PyExc_ValueError, "a joint, link or vector is none of the robot's");
    return false;
  }
  r.waves = static_cast<int>(r.wave.size());
  r.bends = static_cast<int>(r.bend.size());
  r.levers = static_cast<int>(r.lever.size());
  r.tiltings = static_cast<int>(r.tilting.size());
  r.bendings = static_cast<int>(r.bending.size());
  r.moves_frames = r.tiltings > 0 || r.bendings > 0;
  for (int i = 0; i < n; ++i) {
    r.has_payload = r.has_payload || r.compliance[i] != 0.0;
    r.has_torques = r.has_torques || r.torque[i] != 0.0;
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
  PyObject* of_robot = PyObject_GetAttrString(package, "of_robot");
  Py_DECREF(package);
  return of_robot == nullptr ? nullptr : Py_BuildValue("(N(O))", of_robot, reinterpret_cast<Kernel*>(self)->numbers);
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
    {"poses", method(kernel_poses), METH_FASTCALL, "poses(q, stops, checked, out): (n, 4, 4); False where refused"},
    {"effective", method(kernel_effective), METH_FASTCALL, "effective(q, stops, out): effective joints (n, joints)"},
    {"map_slopes", method(kernel_map_slopes), METH_FASTCALL,
     "map_slopes(q, stops, dq, out): (n, joints, joints), their time derivatives where dq is not None"},
    {"jacobians", method(kernel_jacobians), METH_FASTCALL, "jacobians(q, stops, reference, out): (n, 6, joints)"},
    {"rates", method(kernel_rates), METH_FASTCALL, "rates(q, dq, reference, out): time derivatives of jacobians"},
    {"inverses", method(kernel_inverses), METH_FASTCALL,
     "inverses(T, signs, near, position, rotation, q, left, numbers, flags, stages): as Wanted in kernel.hpp; False where refused"},
    {"newton", method(kernel_newton), METH_FASTCALL,
     "newton(T, q, reach, position, rotation, straighten, patience, limits, found): q in place; errors, evaluations (n, 3)"},
    {"branches", method(kernel_branches), METH_FASTCALL, "branches(T, out, valid): joints (48), radius, margins (3) of n poses; (8, n)"},
    {"tip", method(kernel_tip<false>), METH_FASTCALL, "tip(theta): three rows of four"},
    {"nominal_tip", method(kernel_tip<true>), METH_FASTCALL, "nominal_tip(q): the same of the nominal chain"},
    {"nearest", method(kernel_nearest), METH_FASTCALL, "nearest(T, seed, tolerance, lower, upper): theta, errors of place and rotation"},
    {"settled", method(kernel_settled), METH_FASTCALL, "settled(theta, moves, start): commanded joints on a way, or None"},
    {nullptr, nullptr, 0, nullptr}};

PyType_Slot slots[] = {{Py_tp_new, reinterpret_cast<void*>(kernel_new)},
                       {Py_tp_dealloc, reinterpret_cast<void*>(kernel_free)},
                       {Py_tp_methods, methods},
                       {0, nullptr}};
PyType_Spec spec = {"irbcal.kernel.compiled.Kernel", sizeof(Kernel), 0, Py_TPFLAGS_DEFAULT, slots};

PyMethodDef motion_methods[] = {
    {"follow", method(motion_follow), METH_FASTCALL, "follow(t, goal, moving): commands at a time"},
    {"rest", motion_rest, METH_NOARGS, "rest(): where the joints come to rest"},
    {nullptr, nullptr, 0, nullptr}};

PyType_Slot motion_slots[] = {{Py_tp_new, reinterpret_cast<void*>(motion_new)},
                              {Py_tp_methods, motion_methods},
                              {0, nullptr}};
PyType_Spec motion_spec = {"irbcal.kernel.compiled.Motion", sizeof(FollowingArm), 0, Py_TPFLAGS_DEFAULT, motion_slots};

int on_import(PyObject* module) {
  for (PyType_Spec* each : {&spec, &motion_spec}) {
    PyObject* type = PyType_FromSpec(each);
    if (type == nullptr) return -1;
    if (PyModule_AddObject(module, std::strrchr(each->name, '.') + 1, type) < 0) {
      Py_DECREF(type);
      return -1;
    }
  }
  return PyModule_AddStringConstant(module, "sources", IRBCAL_SOURCES);
}

PyModuleDef_Slot module_slots[] = {{Py_mod_exec, reinterpret_cast<void*>(on_import)}, {0, nullptr}};
PyMethodDef functions[] = {
    {"cos_sin", method(cos_sin_of_angles), METH_FASTCALL, "cos_sin(angles, out): cosines and sines (2, ...)"},
    {nullptr, nullptr, 0, nullptr}};
PyModuleDef module = {PyModuleDef_HEAD_INIT, "compiled", "The compiled kernel.", 0, functions, module_slots, nullptr, nullptr, nullptr};

}  // namespace

PyMODINIT_FUNC PyInit_compiled() { return PyModuleDef_Init(&module); }
