// Kinematics of calibrated serial arms: C++17, nothing but the standard library, no allocation, no exceptions.
//
// Every function takes a robot as data, any structure with the members that are used here, and a type of number: double
// for one pose, Lanes for four poses side by side, Dual for a pose and how it changes in time. Sines, cosines and arcs
// are polynomials, so that all give the same numbers on every machine. Radians, metres, kilograms.
// Do not compile with -ffast-math.
#ifndef IRBCAL_KERNEL_HPP
#define IRBCAL_KERNEL_HPP

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

#if defined(__GNUC__) && (defined(__AVX__) || defined(__aarch64__)) && !defined(IRBCAL_LANES)
#define IRBCAL_LANES  // vectors of four numbers, which other options of the compiler do not take well
#endif

#if defined(__GNUC__)
#define IRBCAL_APART __attribute__((noinline))  // taken for few poses: where all is inlined it would be many times over
#else
#define IRBCAL_APART inline
#endif

namespace irbcal {

// ------------------------------------------------------------------ numbers

#if defined(IRBCAL_LANES)
constexpr int width = 4;
typedef double Lanes __attribute__((vector_size(8 * width)));
typedef std::int64_t LaneBits __attribute__((vector_size(8 * width)));
#endif

inline std::int64_t bits(double x) noexcept {
  std::int64_t out;
  std::memcpy(&out, &x, sizeof out);
  return out;
}
inline double from_bits(std::int64_t x) noexcept {
  double out;
  std::memcpy(&out, &x, sizeof out);
  return out;
}
inline double root(double x) noexcept { return std::sqrt(x); }
inline bool any(bool x) noexcept { return x; }
#if defined(IRBCAL_LANES)
inline LaneBits bits(const Lanes& x) noexcept { return (LaneBits)x; }
inline Lanes from_bits(const LaneBits& x) noexcept { return (Lanes)x; }
inline Lanes root(const Lanes& x) noexcept {
  double in[width], out[width];
  std::memcpy(in, &x, sizeof in);
  for (int k = 0; k < width; ++k) out[k] = std::sqrt(in[k]);
  Lanes result;
  std::memcpy(&result, out, sizeof out);
  return result;
}
inline bool any(const LaneBits& x) noexcept {
  std::int64_t out = 0;
  for (int k = 0; k < width; ++k) out |= x[k];
  return out != 0;
}
#endif

template <class S>
inline S all(double x) noexcept {
  return S{} + x;
}
template <class S>
inline S magnitude(const S& x) noexcept {
  return from_bits(bits(x) & std::int64_t{0x7fffffffffffffff});
}
template <class S>
inline S with_sign(const S& x, const S& of) noexcept {
  return from_bits((bits(x) & std::int64_t{0x7fffffffffffffff}) | (bits(of) & ~std::int64_t{0x7fffffffffffffff}));
}
template <class S>
inline S least(const S& a, const S& b) noexcept {
  return a < b ? a : b;
}
template <class S>
inline S most(const S& a, const S& b) noexcept {
  return a < b ? b : a;
}

struct Dual {  // a number and its derivative
  double v = 0.0, d = 0.0;
};
inline Dual operator+(const Dual& a, const Dual& b) noexcept { return {a.v + b.v, a.d + b.d}; }
inline Dual operator+(const Dual& a, double b) noexcept { return {a.v + b, a.d}; }
inline Dual operator+(double a, const Dual& b) noexcept { return {a + b.v, b.d}; }
inline Dual operator-(const Dual& a) noexcept { return {-a.v, -a.d}; }
inline Dual operator-(const Dual& a, const Dual& b) noexcept { return {a.v - b.v, a.d - b.d}; }
inline Dual operator-(double a, const Dual& b) noexcept { return {a - b.v, -b.d}; }
inline Dual operator*(const Dual& a, const Dual& b) noexcept { return {a.v * b.v, a.d * b.v + a.v * b.d}; }
inline Dual operator*(const Dual& a, double b) noexcept { return {a.v * b, a.d * b}; }
inline Dual operator*(double a, const Dual& b) noexcept { return b * a; }
inline Dual operator/(double a, const Dual& b) noexcept { return {a / b.v, -a / (b.v * b.v) * b.d}; }
inline Dual& operator+=(Dual& a, const Dual& b) noexcept { return a = a + b; }
inline Dual& operator+=(Dual& a, double b) noexcept { return a = a + b; }
inline Dual& operator-=(Dual& a, const Dual& b) noexcept { return a = a - b; }
inline Dual root(const Dual& x) noexcept {
  const double y = std::sqrt(x.v);
  return {y, 0.5 * x.d / y};
}

constexpr double magic = 6755399441055744.0;  // 1.5 * 2^52: added to a number, it leaves the nearest whole one
constexpr double pi = 3.14159265358979323846, tau = 2.0 * pi;
constexpr double infinity = std::numeric_limits<double>::infinity(), not_a_number = std::numeric_limits<double>::quiet_NaN();

template <class S>
inline S nearest_whole(const S& x) noexcept {  // below 2^51
  return (x + magic) - magic;
}
template <class S>
inline S down_to_whole(const S& x) noexcept {
  const S near = nearest_whole(x);
  return near > x ? near - 1.0 : near;
}
template <class S>
inline S up_to_whole(const S& x) noexcept {
  const S near = nearest_whole(x);
  return near < x ? near + 1.0 : near;
}

// Angles to a million radians are reduced by a quarter turn in three parts (Cody and Waite), then fdlibm's polynomials.
template <class S>
inline void sine_cosine(const S& x, S& sine, S& cosine) noexcept {
  const S shifted = x * (2.0 / pi) + magic;
  const auto quadrant = bits(shifted);
  const S k = shifted - magic;
  const S first = x - k * 1.57079632673412561417e+00;
  const S second = k * 6.07710050630396597660e-11;
  const S near = first - second;
  const S rest = k * 2.02226624879595063154e-21 - ((first - near) - second);
  const S r = near - rest, tail = (near - r) - rest;
  const S z = r * r;
  const S v = z * r;
  const S ps = 8.33333333332248946124e-03 +
               z * (-1.98412698298579493134e-04 +
                    z * (2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)));
  const S s = r - ((z * (0.5 * tail - v * ps) - tail) + v * 1.66666666666666324348e-01);
  const S pc = z * (4.16666666666666019037e-02 +
                    z * (-1.38888888888741095749e-03 +
                         z * (2.48015872894767294178e-05 +
                              z * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)))));
  const S half = 0.5 * z;
  const S w = 1.0 - half;
  const S c = w + (((1.0 - w) - half) + (z * pc - r * tail));
  const auto odd = (quadrant & std::int64_t{1}) != 0;
  const S a = odd ? c : s, b = odd ? s : c;
  sine = (quadrant & std::int64_t{2}) != 0 ? -a : a;
  cosine = ((quadrant + std::int64_t{1}) & std::int64_t{2}) != 0 ? -b : b;
}

inline void sine_cosine(const Dual& x, Dual& sine, Dual& cosine) noexcept {
  sine_cosine(x.v, sine.v, cosine.v);
  sine.d = cosine.v * x.d;
  cosine.d = -sine.v * x.d;
}

// By Cephes' rational function of the smaller over the larger one, reduced to below 0.66; 0 where both are 0.
template <class S>
inline S arc(const S& y, const S& x) noexcept {
  const S ay = magnitude(y), ax = magnitude(x);
  const auto steep = ay > ax;
  const S large = steep ? ay : ax, small = steep ? ax : ay;
  const auto wide = small > 0.66 * large;
  const S top = wide ? small - large : small, bottom = wide ? small + large : large;
  const S u = bottom > 0.0 ? top / bottom : bottom;
  const S z = u * u;
  const S p = (((-8.750608600031904122785e-1 * z - 1.615753718733365076637e1) * z - 7.500855792314704667340e1) * z -
               1.228866684490136173410e2) * z - 6.485021904942025371773e1;
  const S q = ((((z + 2.485846490142306297962e1) * z + 1.650270098316988542046e2) * z + 4.328810604912902668951e2) * z +
               4.853903996359136964868e2) * z + 1.945506571482613964425e2;
  S r = u * (z * (p / q)) + u;
  r = wide ? pi / 4 + (r + 3.061616997868382943065e-17) : r;
  r = steep ? pi / 2 - (r - 6.123233995736765886130e-17) : r;
  r = x < 0.0 ? pi - (r - 1.224646799147353177226e-16) : r;
  return with_sign(r, y);
}

template <class S>
inline S within_half_turn(const S& x) noexcept {
  return x - nearest_whole(x * (1.0 / tau)) * tau;
}

// ------------------------------------------------------------------ vectors and frames

template <class S>
struct Vector {
  S v[3];
  S& operator[](int k) noexcept { return v[k]; }
  const S& operator[](int k) const noexcept { return v[k]; }
};
template <class S>
inline Vector<S> cross(const Vector<S>& a, const Vector<S>& b) noexcept {
  return { {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]} };
}
template <class S>
inline S dot(const Vector<S>& a, const Vector<S>& b) noexcept {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
template <class S>
inline Vector<S> minus(const Vector<S>& a, const Vector<S>& b) noexcept {
  return { {a[0] - b[0], a[1] - b[1], a[2] - b[2]} };
}

struct Constant {  // a frame in the one before
  double R[3][3], p[3];
};
template <class S>
struct Frame {  // axes x, y, z and origin
  Vector<S> R[3], o;
};

template <class S>
inline Frame<S> at(const Constant& C) noexcept {
  Frame<S> out;
  for (int k = 0; k < 3; ++k) {
    for (int j = 0; j < 3; ++j) out.R[j][k] = all<S>(C.R[k][j]);
    out.o[k] = all<S>(C.p[k]);
  }
  return out;
}
template <class S>
inline Vector<S> turned(const Frame<S>& F, const double* v) noexcept {
  Vector<S> out;
  for (int k = 0; k < 3; ++k) out[k] = F.R[0][k] * v[0] + F.R[1][k] * v[1] + F.R[2][k] * v[2];
  return out;
}
template <class S>
inline void step(Frame<S>& F, const Constant& C) noexcept {
  Frame<S> out;
  for (int k = 0; k < 3; ++k) {
    out.o[k] = F.o[k] + (F.R[0][k] * C.p[0] + F.R[1][k] * C.p[1] + F.R[2][k] * C.p[2]);
    for (int j = 0; j < 3; ++j) out.R[j][k] = F.R[0][k] * C.R[0][j] + F.R[1][k] * C.R[1][j] + F.R[2][k] * C.R[2][j];
  }
  F = out;
}

template <class S, class Robot>
inline void trigonometry(const Robot& r, const S* q, S* c, S* s) noexcept {
  for (int i = 0; i < r.joints; ++i) sine_cosine(q[i], s[i], c[i]);
}

// A small motion of a frame, a rotation vector and a shift, before the joint's place along its axis.
template <class S>
inline void move(Frame<S>& F, const S* xi, double along) noexcept {
  const S x = xi[0], y = xi[1], z = xi[2], angle = root(x * x + y * y + z * z + 1e-300);
  S s, c;
  sine_cosine(0.5 * angle, s, c);
  const S over = 1.0 / angle, first = 2.0 * s * c * over, second = 2.0 * (s * over) * (s * over);
  const S E[3][3] = {{-second * (y * y + z * z), second * x * y - first * z, second * x * z + first * y},
                     {second * x * y + first * z, -second * (x * x + z * z), second * y * z - first * x},
                     {second * x * z - first * y, second * y * z + first * x, -second * (x * x + y * y)}};
  for (int k = 0; k < 3; ++k) {
    const S u = F.R[0][k], v = F.R[1][k], w = F.R[2][k];
    F.R[0][k] += u * E[0][0] + v * E[1][0] + w * E[2][0];
    F.R[1][k] += u * E[0][1] + v * E[1][1] + w * E[2][1];
    const S tilt = u * E[0][2] + v * E[1][2] + w * E[2][2];
    F.R[2][k] += tilt;
    F.o[k] += u * xi[3] + v * xi[4] + w * xi[5] + tilt * along;
  }
}

template <class S>
constexpr S (*no_motions)[6] = nullptr;

// Axes and origin of each joint's link after it has turned or slid; of the last one alone unless every is true. xi: small
// motions of the frames before, or null; depth: how many joints there are on the way.
template <bool every, class S, class Robot>
inline Frame<S> walk(const Robot& r, const Constant* chain, const S* q, const S* c, const S* s, S (*xi)[6],
                     Frame<S>* out, int depth) noexcept {
  Frame<S> F = at<S>(chain[0]);
  for (int i = 0; i < depth; ++i) {
    if (i > 0) step(F, chain[i]);
    if constexpr (Robot::has_frames)
      if (xi != nullptr) move(F, xi[i], r.along[i]);
    for (int k = 0; k < 3; ++k) {
      if (r.slides[i]) {
        F.o[k] += q[i] * F.R[2][k];
      } else {
        const S x = F.R[0][k], y = F.R[1][k];
        F.R[0][k] = c[i] * x + s[i] * y;
        F.R[1][k] = c[i] * y - s[i] * x;
      }
    }
    if constexpr (every) out[i] = F;
  }
  return F;
}

// ------------------------------------------------------------------ the joint map

struct Wave {
  int joint;
  double cycles, cosine, sine;
};
template <int capacity>
struct Bend {
  double coefficient, phase;
  bool of[capacity], to[capacity];
};
template <int capacity>
struct Lever {
  int joint, first, last;  // of the links with vectors
  bool to[capacity];
};
struct LinkVector {
  int link;
  double v[3];
};

template <class S, class Robot>
inline Vector<S> turning(const Robot& r, const Frame<S>* w, int i) noexcept {
  return r.slides[i] ? Vector<S>{} : w[i].R[2];
}

// Gravity by levers, and the payload, both at the nominal attitudes of the links.
template <bool slopes, class S, class Robot>
inline void weights(const Robot& r, const Frame<S>* w, double payload_kg, const double* centre, S* f,
                    S (*J)[Robot::capacity]) noexcept {
  const Vector<S> g{ {all<S>(r.gravity[0]), all<S>(r.gravity[1]), all<S>(r.gravity[2])} };
  for (int l = 0; l < r.levers; ++l) {
    const auto& lever = r.lever[l];
    const Vector<S> z = w[lever.joint].R[2], gz = cross(g, z);
    Vector<S> sum{};  // of the vectors of the links from the last one on
    S by[Robot::capacity];
    for (int i = 0; i < r.joints; ++i) by[i] = S{};
    [[maybe_unused]] int link = r.joints - 1;
    for (int k = lever.last; k >= lever.first; --k) {
      const LinkVector& item = r.link_vector[k];
      if constexpr (slopes)  // joints behind that link do not move the vectors summed so far beyond themselves
        for (; link > item.link; --link) by[link] += dot(cross(turning(r, w, link), sum), gz);
      const Vector<S> v = turned(w[item.link], item.v);
      for (int m = 0; m < 3; ++m) sum[m] += v[m];
    }
    const S value = dot(sum, gz);
    if constexpr (slopes) {
      for (; link >= 0; --link) by[link] += dot(cross(turning(r, w, link), sum), gz);
      const Vector<S> torque = cross(sum, g);
      for (int i = 0; i < lever.joint; ++i) by[i] += dot(cross(turning(r, w, i), z), torque);
    }
    for (int t = 0; t < r.joints; ++t)
      if (lever.to[t]) {
        f[t] += value;
        if constexpr (slopes)
          for (int i = 0; i < r.joints; ++i) J[t][i] += by[i];
      }
  }
  if (!r.has_payload || payload_kg == 0.0) return;
  Frame<S> tip = w[r.joints - 1];
  step(tip, r.nominal_tip);
  const Vector<S> there = turned(tip, centre);
  Vector<S> p;
  for (int k = 0; k < 3; ++k) p[k] = tip.o[k] + there[k];
  for (int j = 0; j < r.joints; ++j) {
    if (r.compliance[j] == 0.0) continue;
    const double size = r.compliance[j] * payload_kg;
    const Vector<S> z = w[j].R[2], arm = minus(p, w[j].o), gz = cross(g, z);
    f[j] += size * dot(arm, gz);
    if constexpr (slopes) {
      const Vector<S> torque = cross(arm, g);
      for (int i = 0; i < r.joints; ++i) {
        const Vector<S> axis = turning(r, w, i);
        Vector<S> moved = cross(axis, i < j ? arm : minus(p, w[i].o));
        if (r.slides[i] && i >= j)
          for (int k = 0; k < 3; ++k) moved[k] += w[i].R[2][k];
        S by = dot(moved, gz);
        if (i < j) by += dot(cross(axis, z), torque);
        J[j][i] += size * by;
      }
    }
  }
}

// What effective joints depend on beside the commands: the stop before as commanded, where it is known, the load, and
// the torques that the robot reports; pointers may be null.
struct Situation {
  const double* before = nullptr;
  const double* torques = nullptr;
  double payload_kg = 0.0;
  const double* payload_centre = nullptr;  // of its centre in the tip link
};
template <class Robot>
inline Situation usual(const Robot& r) noexcept {
  return {nullptr, nullptr, r.payload_kg, r.payload_centre};
}

// What the last move does; moves are commanded joints minus those of the stop before. full: below one, a part of a move.
template <bool slopes, class Robot>
inline void history(const Robot& r, const double* moves, double* f, double (*J)[Robot::capacity], double full = 1.0) noexcept {
  int top = 0;
  for (int i = 1; i < r.joints; ++i)
    if (std::abs(moves[i]) > std::abs(moves[top])) top = i;
  const double largest = std::abs(moves[top]) / full, sign = moves[top] < 0.0 ? -1.0 : 1.0;
  for (int i = 0; i < r.joints; ++i) {
    const double side = r.direction[i] == 0.0 ? 0.0 : std::tanh(moves[i] / r.width[i]);
    f[i] += r.direction[i] * side + r.move[i] * moves[i];
    if (largest > 0.0) f[i] += r.share[i] * moves[i] / largest;
    if constexpr (slopes) {
      J[i][i] += r.direction[i] * (1.0 - side * side) / r.width[i] + r.move[i];
      if (largest > 0.0) {
        J[i][i] += r.share[i] / largest;
        J[i][top] -= r.share[i] * moves[i] * sign / (largest * largest);
      }
    }
  }
}

// Clenshaw's recurrences for the cosines and sines of joints from the first on, so many side by side that none waits for
// another; weighted: for their derivatives.
template <int together, bool weighted, class S, class Robot>
inline void clenshaw(const Robot& r, int first, const S* c, S (&a)[together], S (&a1)[together], S (&b)[together],
                     S (&b1)[together]) noexcept {
  S twice[together];
  for (int i = 0; i < together; ++i) {
    a[i] = a1[i] = b[i] = b1[i] = S{};
    twice[i] = 2.0 * c[first + i];
  }
  for (int k = r.orders; k > 0; k -= 2) {  // two orders a turn
    const double odd = weighted ? k : 1.0, even = weighted ? k - 1 : 1.0;
    const double *u = r.cosine[k - 1] + first, *v = r.sine[k - 1] + first;
    const double *u1 = r.cosine[k - 2] + first, *v1 = r.sine[k - 2] + first;
    for (int i = 0; i < together; ++i) {
      a1[i] = twice[i] * a[i] + (odd * u[i] - a1[i]);
      b1[i] = twice[i] * b[i] + (odd * v[i] - b1[i]);
      a[i] = twice[i] * a1[i] + (even * u1[i] - a[i]);
      b[i] = twice[i] * b1[i] + (even * v1[i] - b[i]);
    }
  }
}
template <int together, bool slopes, class S, class Robot>
inline void series(const Robot& r, int first, const S* c, const S* s, S* f, S (*J)[Robot::capacity]) noexcept {
  S u[together], u1[together], v[together], v1[together];
  clenshaw<together, false>(r, first, c, u, u1, v, v1);
  for (int i = 0; i < together; ++i) f[first + i] += u[i] * c[first + i] - u1[i] + v[i] * s[first + i];
  if constexpr (slopes) {
    clenshaw<together, true>(r, first, c, u, u1, v, v1);
    for (int i = 0; i < together; ++i) J[first + i][first + i] += v[i] * c[first + i] - v1[i] - u[i] * s[first + i];
  }
}

// f: what effective joints are more than commanded ones, without the last move; J: its derivative; c, s: of q.
template <bool slopes, class S, class Robot>
inline void still(const Robot& r, const S* q, const S* c, const S* s, const Situation& at, S* f,
                  S (*J)[Robot::capacity]) noexcept {
  for (int i = 0; i < r.joints; ++i) {
    f[i] = r.offset[i] + r.gain[i] * q[i];
    if constexpr (slopes)
      for (int j = 0; j < r.joints; ++j) J[i][j] = all<S>(i == j ? r.gain[i] : 0.0);
  }
  if (r.orders > 0) {
    constexpr int together = sizeof(S) > sizeof(double) ? 2 : 6;
    int i = 0;
    for (; i + together <= r.joints; i += together) series<together, slopes>(r, i, c, s, f, J);
    for (; i < r.joints; ++i) series<1, slopes>(r, i, c, s, f, J);
  }
  for (int k = 0; k < r.waves; ++k) {
    const Wave& wave = r.wave[k];
    S cx, sx;
    sine_cosine(wave.cycles * q[wave.joint], sx, cx);
    f[wave.joint] += wave.cosine * cx + wave.sine * sx;
    if constexpr (slopes) J[wave.joint][wave.joint] += wave.cycles * (wave.sine * cx - wave.cosine * sx);
  }
  for (int k = 0; k < r.bends; ++k) {
    const auto& bend = r.bend[k];
    S x = all<S>(bend.phase), cx, sx;
    for (int i = 0; i < r.joints; ++i)
      if (bend.of[i]) x += q[i];
    sine_cosine(x, sx, cx);
    for (int t = 0; t < r.joints; ++t) {
      if (!bend.to[t]) continue;
      f[t] += bend.coefficient * sx;
      if constexpr (slopes)
        for (int i = 0; i < r.joints; ++i)
          if (bend.of[i]) J[t][i] += bend.coefficient * cx;
    }
  }
  if (r.levers > 0 || (r.has_payload && at.payload_kg != 0.0)) {
    Frame<S> w[Robot::capacity];
    walk<true>(r, r.nominal, q, c, s, no_motions<S>, w, r.joints);
    weights<slopes>(r, w, at.payload_kg, at.payload_centre, f, J);
  }
  if (r.has_torques && at.torques != nullptr)
    for (int i = 0; i < r.joints; ++i)
      if (r.torque[i] != 0.0 && !std::isnan(at.torques[i])) f[i] += r.torque[i] * at.torques[i];
}

// f: what effective joints are more than commanded ones; map: its slopes; c, s: of q. The last move is for one pose only.
template <bool slopes, class S, class Robot>
inline void shift(const Robot& r, const S* q, const S* c, const S* s, const Situation& at, S* f,
                  S (*map)[Robot::capacity]) noexcept {
  still<slopes>(r, q, c, s, at, f, map);
  if constexpr (sizeof(S) == sizeof(double)) {
    if (at.before == nullptr || !r.has_history) return;
    double moves[Robot::capacity] = {};
    for (int i = 0; i < r.joints; ++i) {
      moves[i] = q[i] - at.before[i];
      if (!std::isfinite(moves[i])) return;
    }
    history<slopes>(r, moves, f, map);
  }
}

// Effective joints of commanded ones.
template <class S, class Robot>
inline void effective(const Robot& r, const S* q, const Situation& at, S* theta) noexcept {
  S c[Robot::capacity], s[Robot::capacity], f[Robot::capacity];
  trigonometry(r, q, c, s);
  shift<false>(r, q, c, s, at, f, static_cast<S(*)[Robot::capacity]>(nullptr));
  for (int i = 0; i < r.joints; ++i) theta[i] = q[i] + f[i];
}

// Solves q + f(q) = theta from a start, joint by joint with the slope between the last two steps: f is small, and what a
// joint is shifted by depends on itself above all. moves: the last move, where it does not change with q; else null.
// False where it does not converge.
template <class Robot>
inline bool settle(const Robot& r, const double* theta, const Situation& at, const double* moves, double* q) noexcept {
  double full = 0.0;
  if (moves != nullptr)
    for (int i = 0; i < r.joints; ++i) full = std::max(full, std::abs(moves[i]) / r.stride[i]);
  double last[Robot::capacity] = {}, step[Robot::capacity] = {};
  for (int it = 0; it < 60; ++it) {
    double f[Robot::capacity], c[Robot::capacity], s[Robot::capacity];
    double (*const none)[Robot::capacity] = nullptr;
    trigonometry(r, q, c, s);
    if (moves == nullptr) {
      shift<false>(r, q, c, s, at, f, none);
    } else {
      still<false>(r, q, c, s, at, f, none);
      if (r.has_history && full > 0.0) history<false>(r, moves, f, none, full);
    }
    double change = 0.0;
    for (int i = 0; i < r.joints; ++i) {
      const double miss = theta[i] - f[i] - q[i];
      const double slope = it > 0 && std::abs(step[i]) > 1e-9 ? (f[i] - last[i]) / step[i] : 0.0;
      step[i] = std::abs(slope) < 0.3 ? miss / (1.0 + slope) : miss;
      last[i] = f[i];
      q[i] += step[i];
      change = std::isfinite(step[i]) ? std::max(change, std::abs(step[i])) : infinity;
    }
    if (!std::isfinite(change)) return false;
    if (change < 1e-12) return true;  // steps shrink at least tenfold: what is left is rounding
  }
  return false;
}

// ------------------------------------------------------------------ small motions of the joints' frames

struct Tilting {  // of a joint's frame by one multiple of its angle: rotations and shifts, three each
  int joint;
  double cycles, cosine[6], sine[6];
};
struct Bending {  // a lever about an axis of the joint's frame, and the motion for each unit of it
  int joint, first, last;
  double axis[3], motion[6];
};

// Motions of the frames before each joint turns, along the axes of its constant frame; c, s: of the commanded joints q.
template <class S, class Robot>
inline void frame_motions(const Robot& r, const S* q, const S* c, const S* s, S (*xi)[6]) noexcept {
  for (int i = 0; i < r.joints; ++i)
    for (int a = 0; a < 6; ++a) xi[i][a] = S{};
  for (int k = 0; k < r.tiltings; ++k) {
    const Tilting& item = r.tilting[k];
    S cx, sx;
    sine_cosine(item.cycles * q[item.joint], sx, cx);
    for (int a = 0; a < 6; ++a) xi[item.joint][a] += item.cosine[a] * cx + item.sine[a] * sx;
  }
  if (r.bendings == 0) return;
  Frame<S> w[Robot::capacity];
  walk<true>(r, r.nominal, q, c, s, no_motions<S>, w, r.joints);
  const Vector<S> g{ {all<S>(r.gravity[0]), all<S>(r.gravity[1]), all<S>(r.gravity[2])} };
  for (int k = 0; k < r.bendings; ++k) {
    const Bending& item = r.bending[k];
    const Frame<S>& at = w[item.joint];
    Vector<S> sum{}, axis;
    for (int m = item.first; m <= item.last; ++m) {
      const Vector<S> v = turned(w[r.link_vector[m].link], r.link_vector[m].v);
      for (int j = 0; j < 3; ++j) sum[j] += v[j];
    }
    for (int j = 0; j < 3; ++j) {  // the joint's turn undone
      const S x = r.slides[item.joint] ? at.R[0][j] : c[item.joint] * at.R[0][j] - s[item.joint] * at.R[1][j];
      const S y = r.slides[item.joint] ? at.R[1][j] : c[item.joint] * at.R[1][j] + s[item.joint] * at.R[0][j];
      axis[j] = x * item.axis[0] + y * item.axis[1] + at.R[2][j] * item.axis[2];
    }
    const S value = dot(axis, cross(sum, g));
    for (int a = 0; a < 6; ++a) xi[item.joint][a] += value * item.motion[a];
  }
}

// ------------------------------------------------------------------ forward, with its derivative

// The tip in the base for commanded joints, links on the way where slopes are wanted.
template <bool slopes, class S, class Robot>
inline Frame<S> forward(const Robot& r, const S* q, const Situation& at, S (*map)[Robot::capacity], Frame<S>* links) noexcept {
  S c[Robot::capacity]{}, s[Robot::capacity]{}, theta[Robot::capacity], xi[Robot::has_frames ? Robot::capacity : 1][6];
  for (int i = 0; i < r.joints; ++i) theta[i] = q[i];
  if (r.has_map || (Robot::has_frames && r.moves_frames)) {
    S f[Robot::capacity];
    trigonometry(r, q, c, s);
    if constexpr (Robot::has_frames)
      if (r.moves_frames) frame_motions(r, q, c, s, xi);
    if (r.has_map) {
      shift<slopes>(r, q, c, s, at, f, map);
      for (int i = 0; i < r.joints; ++i) theta[i] += f[i];
    }
  }
  trigonometry(r, theta, c, s);
  const bool moves = Robot::has_frames && r.moves_frames;
  Frame<S> tip = walk<slopes>(r, r.chain, theta, c, s, moves ? xi : no_motions<S>, links, r.depth);
  step(tip, r.tip);
  return tip;
}
template <class S, class Robot>
inline Frame<S> forward(const Robot& r, const S* q, const Situation& at) noexcept {
  return forward<false>(r, q, at, static_cast<S(*)[Robot::capacity]>(nullptr), static_cast<Frame<S>*>(nullptr));
}

// The tip for joints of the chain itself, calibrated or nominal.
template <class S, class Robot>
inline Frame<S> tip_of(const Robot& r, const Constant* chain, const Constant& last, const S* theta) noexcept {
  S c[Robot::capacity], s[Robot::capacity];
  trigonometry(r, theta, c, s);
  Frame<S> tip = walk<false>(r, chain, theta, c, s, no_motions<S>, static_cast<Frame<S>*>(nullptr), r.joints);
  step(tip, last);
  return tip;
}

// Derivative of the tip's place and rotation along the axes of the base, links given, by effective joints; by commanded
// ones where there are slopes of the joint map. What motions of the frames change with the joints is left out of it.
template <class S, class Robot>
inline void jacobian(const Robot& r, const Frame<S>& tip, const Frame<S>* links, S (*map)[Robot::capacity],
                     S (*J)[Robot::capacity]) noexcept {
  S G[6][Robot::capacity];
  for (int j = 0; j < r.depth; ++j) {
    const Vector<S> z = links[j].R[2], linear = r.slides[j] ? z : cross(z, minus(tip.o, links[j].o));
    for (int k = 0; k < 3; ++k) {
      G[k][j] = linear[k];
      G[k + 3][j] = r.slides[j] ? S{} : z[k];
    }
  }
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < r.joints; ++j) {
      J[i][j] = j < r.depth ? G[i][j] : S{};
      if (map != nullptr)
        for (int k = 0; k < r.depth; ++k) J[i][j] += G[i][k] * map[k][j];
    }
}

// Tip and its derivative by the commanded joints.
template <class S, class Robot>
inline Frame<S> with_jacobian(const Robot& r, const S* q, const Situation& at, S (*J)[Robot::capacity]) noexcept {
  S map[Robot::capacity][Robot::capacity];
  Frame<S> links[Robot::capacity];
  const Frame<S> tip = forward<true>(r, q, at, map, links);
  jacobian(r, tip, links, r.has_map ? map : nullptr, J);
  return tip;
}

// The same for effective joints.
template <class S, class Robot>
inline Frame<S> chain_with_jacobian(const Robot& r, const S* theta, S (*J)[Robot::capacity]) noexcept {
  S c[Robot::capacity], s[Robot::capacity];
  Frame<S> links[Robot::capacity];
  trigonometry(r, theta, c, s);
  Frame<S> tip = walk<true>(r, r.chain, theta, c, s, no_motions<S>, links, r.depth);
  step(tip, r.tip);
  jacobian(r, tip, links, static_cast<S(*)[Robot::capacity]>(nullptr), J);
  return tip;
}

// ------------------------------------------------------------------ the closed form of ortho-parallel arms

constexpr double on_singularity = 1e-12;   // sine of q5 below which q4 is not defined by the pose
constexpr double reach_tolerance = 1e-12;  // metres by which rounding may put a pose beyond the reach

struct ClosedForm {
  double a2, a3, d4, a4, bend;
  double signs[6], shifts[6];
  Constant left, right;  // the hand is left T right, its origin the wrist centre
};

template <class S>
struct Hand {  // what all branches of a pose have in common
  Vector<S> R[3];
  S c1, s1, k2, radius, along[3], across[3];
};

template <class S>
inline Hand<S> hand_of(const ClosedForm& a, const Frame<S>& T) noexcept {
  Frame<S> F = T;
  step(F, a.right);
  Hand<S> out;
  Vector<S> p;
  for (int k = 0; k < 3; ++k) {
    for (int j = 0; j < 3; ++j)
      out.R[j][k] = a.left.R[k][0] * F.R[j][0] + a.left.R[k][1] * F.R[j][1] + a.left.R[k][2] * F.R[j][2];
    p[k] = a.left.R[k][0] * F.o[0] + a.left.R[k][1] * F.o[1] + a.left.R[k][2] * F.o[2] + a.left.p[k];
  }
  out.radius = root(p[0] * p[0] + p[1] * p[1]);
  const auto on_axis = out.radius == 0.0;
  const S one = all<S>(1.0), over = one / (on_axis ? one : out.radius);
  out.c1 = on_axis ? one : p[0] * over;
  out.s1 = p[1] * over;
  out.k2 = p[2];
  for (int j = 0; j < 3; ++j) {
    out.along[j] = out.R[j][0] * out.c1 + out.R[j][1] * out.s1;
    out.across[j] = out.R[j][1] * out.c1 - out.R[j][0] * out.s1;
  }
  return out;
}

template <class S>
inline S joint_of(const ClosedForm& a, int joint, const S& q) noexcept {
  return within_half_turn(a.signs[joint] * q + a.shifts[joint]);
}

// Joints 2 and 3, and cosine and sine of the angle of the forearm (Nubiola 2011, section 6.1, as irbcal/modeling/inverse
// has it). Returns how far the wrist centre is within the reach, metres; the joints are of the nearest one beyond it.
template <class S>
inline S elbow(const ClosedForm& a, const Hand<S>& hand, const S& front, const S& up, S* q, S& c23, S& s23) noexcept {
  const double L = std::sqrt(a.a4 * a.a4 + a.d4 * a.d4), inner = std::abs(a.a3 - L), outer = a.a3 + L;
  const S k1 = front * hand.radius - a.a2, k2 = hand.k2;
  const S rho2 = k1 * k1 + k2 * k2, rho = root(rho2);
  S low = rho - inner, high = outer - rho;
  const S margin = least(low, high);
  low *= rho + inner;
  high *= rho + outer;
  S along = (low - high) * (0.25 / a.a3);
  const S across = up * (root(most(low * high, S{})) * (0.5 / a.a3));
  const S delta = arc(across, along);
  along += a.a3;
  const S s2 = k1 * along - k2 * across, c2 = k2 * along + k1 * across;
  const S scale = a.a3 / rho2;
  const S u = k1 - s2 * scale, v = c2 * scale - k2;
  const double cosine = a.d4 / (L * L), sine = a.a4 / (L * L);
  c23 = u * cosine - v * sine;
  s23 = v * cosine + u * sine;
  q[1] = joint_of(a, 1, arc(s2, c2));
  q[2] = within_half_turn(a.bend + a.signs[2] * delta);
  return margin;
}

// Angles q4, q5 and q6 of the thesis with sin q5 >= 0; where the pose leaves it open q4 is zero.
template <class S>
inline void wrist(const Hand<S>& hand, const S& front, const S& c23, const S& s23, S* angle) noexcept {
  const S ar = front * hand.along[2], at = front * hand.across[2];
  const S c5 = c23 * ar - s23 * hand.R[2][2];
  const S open = -hand.R[2][2] * c23 - s23 * ar;  // cos q4 sin q5
  const S s5 = root(open * open + at * at);
  const auto singular = s5 < on_singularity;
  const S x = singular ? all<S>(1.0) : open, y = singular ? S{} : at;
  const S first = (front * hand.along[0] * s23 + hand.R[0][2] * c23) * y + front * hand.across[0] * x;
  const S second = (front * hand.along[1] * s23 + hand.R[1][2] * c23) * y + front * hand.across[1] * x;
  angle[0] = arc(y, x);
  angle[1] = arc(s5, c5);
  angle[2] = arc(first, second);
}

// Joints 4, 5 and 6 from these angles, flipped where straight is -1.
template <class S>
inline void wrist_joints(const ClosedForm& a, const S* angle, const S& straight, S* q) noexcept {
  const S half = (1.0 - straight) * (0.5 * pi);
  q[3] = joint_of(a, 3, angle[0] - with_sign(half, angle[0]));
  q[4] = joint_of(a, 4, straight * angle[1]);
  q[5] = joint_of(a, 5, angle[2] - with_sign(half, angle[2]));
}

// One branch, each joint within a half turn of zero; signs are 1 where front, up, not flipped, else -1.
template <class S>
inline S branch(const ClosedForm& a, const Hand<S>& hand, const S& front, const S& up, const S& straight, S* q) noexcept {
  S c23, s23, angle[3];
  const S margin = elbow(a, hand, front, up, q, c23, s23);
  wrist(hand, front, c23, s23, angle);
  wrist_joints(a, angle, straight, q);
  q[0] = joint_of(a, 0, arc(hand.s1 * front, hand.c1 * front));
  return margin;
}

// Whether the elements of a pose (its last row apart) are those of a rigid transform.
template <class S>
inline auto rigid(const Frame<S>& T) noexcept {
  S squares = S{}, place = S{};
  for (int j = 0; j < 3; ++j) {
    squares += dot(T.R[j], T.R[j]);
    place += magnitude(T.o[j]);
  }
  return (magnitude(squares - 3.0) <= 1e-6) & (magnitude(dot(cross(T.R[0], T.R[1]), T.R[2]) - 1.0) <= 1e-6) &
         (place < infinity);
}

// The thesis's angle of a joint, and the distance of the wrist centre from axis 1, negative behind it.
template <class S>
inline S angle_of(const ClosedForm& a, const S* q, int joint) noexcept {
  return (q[joint] - a.shifts[joint]) * a.signs[joint];
}
template <class S>
inline S radius_of(const ClosedForm& a, const S* q) noexcept {
  const S q2 = angle_of(a, q, 1);
  S s2, c2, s23, c23;
  sine_cosine(q2, s2, c2);
  sine_cosine(q2 + angle_of(a, q, 2), s23, c23);
  return a.a2 + a.a3 * s2 + a.d4 * c23 + a.a4 * s23;
}

// Branch that joints lie in: -1 where behind axis 1, where down, where flipped, else 1.
template <class S>
inline void branch_signs(const ClosedForm& a, const S* q, S* signs) noexcept {
  const S one = all<S>(1.0);
  signs[0] = radius_of(a, q) < 0.0 ? -one : one;
  signs[1] = within_half_turn(a.signs[2] * (q[2] - a.bend)) < 0.0 ? -one : one;
  signs[2] = within_half_turn(angle_of(a, q, 4)) < 0.0 ? -one : one;
}

// The branch, and the turns within the limits, nearest to given joints; false where none is within reach and limits.
template <class Robot>
inline bool nearest_branch(const Robot& r, const ClosedForm& a, const Frame<double>& wanted, const double* near, double* q) noexcept {
  const Hand<double> hand = hand_of(a, wanted);
  double least_distance = infinity;
  for (int b = 0; b < 8; ++b) {
    double x[6], distance = 0.0;
    if (!(branch(a, hand, b & 4 ? -1.0 : 1.0, b & 2 ? -1.0 : 1.0, b & 1 ? -1.0 : 1.0, x) >= -reach_tolerance)) continue;
    for (int i = 0; i < 6; ++i) {
      const double first = std::ceil((r.lower[i] - x[i]) / tau), last = std::floor((r.upper[i] - x[i]) / tau);
      if (!(first <= last)) distance = infinity;
      x[i] += tau * std::min(std::max(std::nearbyint((near[i] - x[i]) / tau), first), last);
      distance += (x[i] - near[i]) * (x[i] - near[i]);
    }
    if (!(distance < least_distance)) continue;
    least_distance = distance;
    std::copy(x, x + 6, q);
  }
  return least_distance < infinity;
}

// ------------------------------------------------------------------ the calibrated inverse

constexpr int iterations = 24;
constexpr double stalled = 0.5, slack = 0.05, limit_tolerance = 1e-9;

template <class S>
struct Solution {
  S q[6], position, rotation, margin, steps;
};

// Turns of a joint within the limits, but for some slack, nearest to a joint.
template <class S, class Robot>
inline S start_turn(const Robot& r, int i, const S& q, const S* near) noexcept {
  const double lower = r.lower[i] - slack, upper = r.upper[i] + slack;
  auto stay = (q >= lower) & (q <= upper);
  S close = S{};
  if (near != nullptr) {
    close = near[i];
    stay = stay & (magnitude(close - q) <= pi);
  }
  const S first = up_to_whole((most(all<S>(lower), all<S>(-1e6)) - q) * (1.0 / tau));
  const S final = down_to_whole((least(all<S>(upper), all<S>(1e6)) - q) * (1.0 / tau));
  const S turns = nearest_whole((close - q) * (1.0 / tau));
  const S chosen = first <= final ? least(most(turns, first), final) : turns;
  return stay ? q : q + tau * chosen;
}

// The fixed point of Nubiola 2011, section 6.2: the nominal closed form, in one branch, of targets that are moved by what
// the calibrated tip lacks. near: joints whose turns are kept, or null. What is not within the tolerances in the end is
// left to other methods; where the wanted pose is beyond the nominal reach all is NaN.
template <class S, class Robot>
inline Solution<S> fixed_point(const Robot& r, const ClosedForm& a, const Frame<S>& wanted, const S* signs, const S* near,
                               double reach, double position, double rotation) noexcept {
  Solution<S> out;
  for (int i = 0; i < 6; ++i) out.q[i] = all<S>(not_a_number);
  out.position = out.rotation = all<S>(not_a_number);
  out.steps = S{};
  Frame<S> fake = wanted;
  S q[6], before[6], last = all<S>(infinity);
  auto alive = last > 0.0;
  for (int count = 1; count <= iterations && any(alive); ++count) {
    const S margin = branch(a, hand_of(a, fake), signs[0], signs[1], signs[2], q);
    const S lost = margin >= -reach_tolerance ? S{} : all<S>(not_a_number);
    if (count == 1) out.margin = margin;
    for (int i = 0; i < 6; ++i) {
      q[i] += lost;
      if (count > 1) {
        q[i] += nearest_whole((before[i] - q[i]) * (1.0 / tau)) * tau;
        continue;
      }
      q[i] = start_turn(r, i, q[i], near);
    }
    const Frame<S> tip = forward(r, q, usual(r));
    S chord = S{}, length = S{};
    for (int k = 0; k < 3; ++k) {
      const S lacks = wanted.o[k] - tip.o[k];
      length += lacks * lacks;
      for (int j = 0; j < 3; ++j) {
        const S off = wanted.R[j][k] - tip.R[j][k];
        chord += off * off;
      }
    }
    const S sine = root(least(chord * 0.125, all<S>(1.0)));
    const S place = root(length), turn = 2.0 * arc(sine, root(1.0 - sine * sine));
    const S merit = place * (1.0 / reach) + turn;
    const auto better = alive & (merit < last);
    for (int i = 0; i < 6; ++i) out.q[i] = better ? q[i] : out.q[i];
    out.position = better ? place : out.position;
    out.rotation = better ? turn : out.rotation;
    out.steps = alive ? out.steps + 1.0 : out.steps;
    alive = alive & (merit <= stalled * last) & ((place > position) | (turn > rotation));
    last = merit;
    Frame<S> moved;  // fake times the inverse of the tip, times what is wanted
    for (int j = 0; j < 4; ++j) {
      const Vector<S> column = j < 3 ? wanted.R[j] : minus(wanted.o, tip.o);
      const Vector<S> inner{ {dot(tip.R[0], column), dot(tip.R[1], column), dot(tip.R[2], column)} };
      Vector<S>& goal = j < 3 ? moved.R[j] : moved.o;
      for (int k = 0; k < 3; ++k)
        goal[k] = fake.R[0][k] * inner[0] + fake.R[1][k] * inner[1] + fake.R[2][k] * inner[2];
    }
    for (int k = 0; k < 3; ++k) moved.o[k] += fake.o[k];
    fake = moved;
    for (int i = 0; i < 6; ++i) before[i] = q[i];
  }
  return out;
}

struct Steps {  // of Newton's method; limits may be null; mapped: joints are commanded ones, else effective
  double position, rotation;
  int straighten, patience;
  const double *lower, *upper;
  bool mapped = true;
};

template <class Robot>
struct Linear {
  double J[6][Robot::capacity], e[6], cost, position, rotation;
};

// What a step from q needs: lengths are over the reach.
template <class Robot>
inline void linearise(const Robot& r, const Frame<double>& wanted, double reach, bool mapped, const double* q,
                      Linear<Robot>& out) noexcept {
  const Frame<double> tip = mapped ? with_jacobian(r, q, usual(r), out.J) : chain_with_jacobian(r, q, out.J);
  for (int k = 0; k < 3; ++k)
    for (int j = 0; j < r.joints; ++j) out.J[k][j] /= reach;
  double length = 0.0, chord = 0.0, trace = 0.0;
  Vector<double> v{};
  for (int j = 0; j < 3; ++j) {
    const Vector<double> turn = cross(tip.R[j], wanted.R[j]), off = minus(tip.R[j], wanted.R[j]);
    for (int k = 0; k < 3; ++k) v[k] += 0.5 * turn[k];
    chord += dot(off, off);
    trace += dot(tip.R[j], wanted.R[j]);
    const double lacks = wanted.o[j] - tip.o[j];
    out.e[j] = lacks / reach;
    length += lacks * lacks;
  }
  const double sine = std::sqrt(dot(v, v));
  const double scale = sine > 1e-12 ? std::atan2(sine, 0.5 * (trace - 1.0)) / sine : 1.0;
  out.cost = 0.0;
  for (int k = 0; k < 3; ++k) out.e[k + 3] = scale * v[k];
  for (int k = 0; k < 6; ++k) out.cost += out.e[k] * out.e[k];
  out.position = std::sqrt(length);
  out.rotation = 2.0 * std::asin(std::min(std::sqrt(0.125 * chord), 1.0));
}

// Adds a damped least-squares step, in which no joint moves by more than half a radian (or metre). Columns are made
// orthogonal one after the other (Gram and Schmidt, modified): products of slopes would lose what two singularities at once
// leave of them.
template <class Robot>
inline void damped_step(const Robot& r, const Linear<Robot>& at, const Steps& steps, double damping, double* q) noexcept {
  const int n = r.joints, rows = 6 + n;
  double A[Robot::capacity][6 + Robot::capacity] = {}, R[Robot::capacity][Robot::capacity], b[6 + Robot::capacity] = {}, x[Robot::capacity];
  std::copy(at.e, at.e + 6, b);
  for (int j = 0; j < n; ++j) {
    double slope = 0.0;
    for (int k = 0; k < 6; ++k) slope += at.J[k][j] * at.e[k];
    const bool stuck = steps.lower != nullptr && ((q[j] <= steps.lower[j] && slope < 0.0) || (q[j] >= steps.upper[j] && slope > 0.0));
    for (int k = 0; k < 6; ++k) A[j][k] = stuck ? 0.0 : at.J[k][j];  // a joint that less error would lead beyond its limit
    A[j][6 + j] = std::sqrt(damping);
  }
  for (int j = 0; j < n; ++j) {
    double square = 0.0, along = 0.0;
    for (int k = 0; k < rows; ++k) square += A[j][k] * A[j][k];
    const double over = 1.0 / std::sqrt(square);
    for (int k = 0; k < rows; ++k) {
      A[j][k] *= over;
      along += A[j][k] * b[k];
    }
    R[j][j] = over;
    x[j] = along;
    for (int k = 0; k < rows; ++k) b[k] -= along * A[j][k];
    for (int i = j + 1; i < n; ++i) {
      double share = 0.0;
      for (int k = 0; k < rows; ++k) share += A[j][k] * A[i][k];
      for (int k = 0; k < rows; ++k) A[i][k] -= share * A[j][k];
      R[j][i] = share;
    }
  }
  double longest = 0.5;
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k) x[i] -= R[i][k] * x[k];
    x[i] *= R[i][i];
    longest = std::max(longest, std::abs(x[i]));
  }
  for (int i = 0; i < n; ++i) q[i] += x[i] * (0.5 / longest);
}

// Levenberg-Marquardt from q, as irbcal.modeling.inverse.newton.solve; returns the number of evaluations.
template <class Robot>
inline int newton(const Robot& r, const Frame<double>& wanted, double reach, const Steps& steps, double* q, double& position,
                  double& rotation) noexcept {
  Linear<Robot> at, next;
  linearise(r, wanted, reach, steps.mapped, q, at);
  double damping = 1e-6, bound = infinity;
  int evaluations = 1, waited = 0;
  for (int count = 0; count < 6 * steps.patience; ++count) {
    const bool halved = at.cost <= 0.25 * bound;  // the cost is the square of the error
    if (halved) bound = at.cost;
    waited = halved ? 0 : waited + 1;
    const bool good = at.position <= steps.position && at.rotation <= steps.rotation;
    if (good || waited > steps.patience || !std::isfinite(at.cost)) break;
    double trial[Robot::capacity];
    std::copy(q, q + r.joints, trial);
    for (int k = 0; k <= steps.straighten; ++k) {
      const double weight = damping * std::min(std::sqrt(at.cost), 1.0) + 1e-20;
      damped_step(r, k > 0 ? next : at, steps, k > 0 ? 1e-5 : weight, trial);
      if (steps.lower != nullptr)
        for (int i = 0; i < r.joints; ++i) trial[i] = std::min(std::max(trial[i], steps.lower[i]), steps.upper[i]);
      linearise(r, wanted, reach, steps.mapped, trial, next);
    }
    evaluations += 1 + steps.straighten;
    const bool better = next.cost < at.cost;
    damping = better ? std::max(damping * 0.2, 1e-8) : std::min(damping * 8.0 + 1e-6, 1e8);
    if (better) {
      std::copy(trial, trial + r.joints, q);
      at = next;
    }
  }
  position = at.position;
  rotation = at.rotation;
  return evaluations;
}

// The branch of a pose whose wrist centre is brought inside the reach where it is beyond it, or nearer to its limits.
template <class Robot>
inline void start_of(const Robot& r, const Frame<double>& wanted, const double* signs, const double* near, double* q) noexcept {
  const ClosedForm& a = r.closed;
  const double L = std::sqrt(a.a4 * a.a4 + a.d4 * a.d4), inside = 5e-4 * r.reach;
  Hand<double> hand = hand_of(a, wanted);
  const double k1 = signs[0] * hand.radius - a.a2, k2 = hand.k2, rho = std::sqrt(k1 * k1 + k2 * k2);
  const double limited = std::min(std::max(rho, std::abs(a.a3 - L) + inside), a.a3 + L - inside);
  hand.radius = signs[0] * ((rho > 0.0 ? k1 * (limited / rho) : limited) + a.a2);
  hand.k2 = rho > 0.0 ? k2 * (limited / rho) : 0.0;
  branch(a, hand, signs[0], signs[1], signs[2], q);
  for (int i = 0; i < 6; ++i) q[i] = start_turn(r, i, q[i], near);
}

template <class Robot>
inline bool within_limits(const Robot& r, const double* q) noexcept {
  for (int i = 0; i < 6; ++i)
    if (!(q[i] >= r.lower[i] - limit_tolerance && q[i] <= r.upper[i] + limit_tolerance)) return false;
  return true;
}

// Brings a solution beyond a limit back by whole turns, and by what the tolerances leave open; false where that fails.
template <class Robot>
IRBCAL_APART bool into_limits(const Robot& r, const Frame<double>& wanted, const double* near, double position, double rotation,
                        Solution<double>& out) noexcept {
  constexpr double rounding = 1e-4;
  double q[6], p, t;
  for (int i = 0; i < 6; ++i) {
    const double first = std::ceil((r.lower[i] - rounding - out.q[i]) / tau), last = std::floor((r.upper[i] + rounding - out.q[i]) / tau);
    if (!(first <= last)) return false;
    const double turns = std::nearbyint(((near == nullptr ? 0.0 : near[i]) - out.q[i]) / tau);
    q[i] = out.q[i] + tau * std::min(std::max(turns, first), last);
  }
  out.steps += newton(r, wanted, r.reach, Steps{0.0, 0.0, 0, 3, nullptr, nullptr}, q, p, t);
  for (int i = 0; i < 6; ++i) q[i] = std::min(std::max(q[i], r.lower[i]), r.upper[i]);
  Linear<Robot> at;
  linearise(r, wanted, r.reach, true, q, at);
  if (!(at.position <= position && at.rotation <= rotation)) return false;
  std::copy(q, q + 6, out.q);
  out.position = at.position;
  out.rotation = at.rotation;
  return true;
}

struct Stage {  // starts, and Steps' straighten and patience, of Newton's method for what the fixed point leaves
  int starts, straighten, patience;
  bool within;  // starts around a seed of the branch, and steps within the limits
};
constexpr Stage stages[] = {{1, 0, 10, false}, {12, 1, 3, true}, {6, 0, 10, false}, {24, 2, 10, false},
                            {96, 2, 10, false}, {64, 2, 30, false}, {1, 2, 100, false}};
constexpr double around = 0.03;  // radians: of the starts around a seed
constexpr double near_seed = 0.1;  // radians: in whatever branch, such a solution is the one of the seed
constexpr double close_enough = 0.1;  // of the distance between the arms' tips: what is left of a pose that may be reached
constexpr int most_stages = 7, starts_of_all = 12 + 6 + 24 + 96 + 64;

// Whether the nominal arm does not reach a pose, nor the calibrated one nearly so.
template <class Robot>
inline bool beyond(const Robot& r, double margin, double position) noexcept {
  return margin < 0.0 && !(position <= close_enough * r.difference);
}

// Newton's steps for a pose that the fixed point left, from where it came to, then from many starts: until one ends in the
// branch, or next to near, and within the limits. As irbcal/modeling/inverse/calibrated_arm.py has it. True where out is a
// better solution than before; without any, its errors are those of the best joints.
// first_rank: of the solution in out; infinite where it is none, -2 where it is one in the branch but beyond the limits.
// r.starts: six standard normal numbers for each start; r.difference: metres between the tips of nominal and calibrated arm.
template <class Robot>
IRBCAL_APART bool search(const Robot& r, const Frame<double>& wanted, const double* signs, const double* near, int count,
                   double position, double rotation, double first_rank, Solution<double>& out) noexcept {
  bool lacking = out.margin > -2.0 * r.difference;
  const ClosedForm& a = r.closed;
  double pulled[6], best[6], best_rank = first_rank, left[2] = {out.position, out.rotation};
  start_of(r, wanted, signs, near, pulled);
  const bool finite = std::isfinite(out.q[0] + out.q[1] + out.q[2] + out.q[3] + out.q[4] + out.q[5]);
  std::copy(finite ? out.q : pulled, (finite ? out.q : pulled) + 6, best);
  if (!lacking) {  // how far the pose is from the nearest joints
    Linear<Robot> at;
    linearise(r, wanted, r.reach, true, best, at);
    left[0] = at.position;
    left[1] = at.rotation;
    out.steps += 1.0;
  }
  const double q5 = angle_of(a, pulled, 4);
  const bool plain = std::abs(q5 - pi * std::nearbyint(q5 / pi)) > 0.05 && std::abs(radius_of(a, pulled)) > 5.0 * r.difference;
  bool folds = true;
  for (int i = 1; i < 3; ++i) folds = folds && pulled[i] >= r.lower[i] - 0.2 && pulled[i] <= r.upper[i] + 0.2;
  bool near_is_there = near != nullptr;
  if (near_is_there) {
    double there[3];
    branch_signs(a, near, there);
    for (int i = 0; i < 3; ++i) near_is_there = near_is_there && there[i] == signs[i];
  }
  const double* next = r.starts;
  for (int s = 0; s < count && best_rank > -4.0; ++s) {
    const Stage& stage = stages[s];
    const double* of = next;
    if (stage.starts > 1) next += 6 * stage.starts;
    if (stage.starts > 6) lacking = lacking && folds && !(plain && beyond(r, out.margin, left[0]));
    if (stage.within ? !near_is_there : !lacking) continue;  // a seed may be across a singularity from its solution
    const Steps steps{position, rotation, stage.straighten, stage.patience, stage.within ? r.lower : nullptr, r.upper};
    for (int k = 0; k < stage.starts && best_rank > -4.0; ++k) {
      double q[6], p = 0.0, t = 0.0, there[3];
      if (stage.starts == 1) {
        std::copy(best, best + 6, q);
      } else if (stage.within) {
        for (int i = 0; i < 6; ++i)
          q[i] = std::min(std::max(near[i] + (k > 0 ? around * of[6 * (k - 1) + i] : 0.0), r.lower[i]), r.upper[i]);
      } else if (k == 0 || (k == 1 && near != nullptr)) {
        std::copy(k == 0 ? pulled : near, (k == 0 ? pulled : near) + 6, q);
      } else {  // solutions of targets moved a little: on all sides of the holes that errors leave at singularities
        constexpr double turns[3] = {0.01, 0.0, 0.03}, shifts[3] = {0.0, 0.5, 1.5};
        Vector<double> axis{ {of[0], of[1], of[2]} };
        const double length = std::sqrt(dot(axis, axis)), angle = turns[k % 3] * length;
        double sine, cosine;
        sine_cosine(angle, sine, cosine);
        for (int m = 0; m < 3; ++m) axis[m] /= length;
        Frame<double> goal = wanted;
        for (int m = 0; m < 3; ++m) {
          const Vector<double> v = wanted.R[m], across = cross(axis, v);
          const double along = dot(axis, v);
          for (int j = 0; j < 3; ++j) goal.R[m][j] += sine * across[j] + (1.0 - cosine) * (axis[j] * along - v[j]);
          goal.o[m] += shifts[k % 3] * r.difference * of[3 + m];
        }
        of += 6;
        start_of(r, goal, signs, near, q);
      }
      out.steps += newton(r, wanted, r.reach, steps, q, p, t);
      bool fits = within_limits(r, q);
      if (p <= position && t <= rotation && !fits) {
        Solution<double> back{};
        std::copy(q, q + 6, back.q);
        fits = into_limits(r, wanted, near, position, rotation, back);
        out.steps += back.steps;
        if (fits) {
          std::copy(back.q, back.q + 6, q);
          p = back.position;
          t = back.rotation;
        }
      }
      branch_signs(a, q, there);
      double apart = near == nullptr ? infinity : 0.0;
      for (int i = 0; near != nullptr && i < 6; ++i) apart = std::max(apart, std::abs(q[i] - near[i]));
      const bool same = apart < near_seed || (there[0] == signs[0] && there[1] == signs[1] && there[2] == signs[2]);
      const double rank = p <= position && t <= rotation ? -1.0 - same - 2.0 * fits : p / r.reach + t;
      if (!(rank < best_rank)) continue;
      best_rank = rank;
      std::copy(q, q + 6, best);
      left[0] = p;
      left[1] = t;
    }
    if (stage.starts >= 6 && !stage.within && best_rank <= -3.0) break;
  }
  std::copy(best, best + 6, out.q);
  out.position = left[0];
  out.rotation = left[1];
  return best_rank < std::min(first_rank, 0.0);
}

// ------------------------------------------------------------------ many poses

template <class S>
S gathered(const double* from, std::ptrdiff_t stride, std::ptrdiff_t first, std::ptrdiff_t n);
template <>
inline double gathered<double>(const double* from, std::ptrdiff_t stride, std::ptrdiff_t first, std::ptrdiff_t) {
  return from[first * stride];
}
inline void scatter(const double& x, double* to, std::ptrdiff_t stride, std::ptrdiff_t first, std::ptrdiff_t) { to[first * stride] = x; }
inline double lane(const double& x, std::ptrdiff_t) { return x; }
template <class S>
constexpr std::ptrdiff_t side_by_side = 1;
#if defined(IRBCAL_LANES)
template <>
inline Lanes gathered<Lanes>(const double* from, std::ptrdiff_t stride, std::ptrdiff_t first, std::ptrdiff_t n) {
  Lanes out;
  for (std::ptrdiff_t k = 0; k < width; ++k) out[k] = from[(first + (k < n ? k : n - 1)) * stride];
  return out;
}
inline void scatter(const Lanes& x, double* to, std::ptrdiff_t stride, std::ptrdiff_t first, std::ptrdiff_t n) {
  for (std::ptrdiff_t k = 0; k < n; ++k) to[(first + k) * stride] = x[k];
}
inline double lane(const Lanes& x, std::ptrdiff_t k) { return x[k]; }
template <>
constexpr std::ptrdiff_t side_by_side<Lanes> = width;
using Widest = Lanes;
#else
using Widest = double;
#endif

// What n stops depend on beside the commands, rows each: the stop before, the load (a mass, its centre), torques; pointers
// may be null, and what is no number is not known.
struct Stops {
  const double *before = nullptr, *payload_kg = nullptr, *payload_centre = nullptr, *torques = nullptr;
  bool known() const noexcept {
    return before != nullptr || payload_kg != nullptr || payload_centre != nullptr || torques != nullptr;
  }
};
template <class Robot>
inline Situation situation_of(const Robot& r, const Stops& stops, std::ptrdiff_t k) noexcept {
  Situation at = usual(r);
  if (stops.before != nullptr) at.before = stops.before + k * r.joints;
  if (stops.torques != nullptr) at.torques = stops.torques + k * r.joints;
  if (stops.payload_kg != nullptr && std::isfinite(stops.payload_kg[k])) at.payload_kg = stops.payload_kg[k];
  if (stops.payload_centre != nullptr) {
    const double* v = stops.payload_centre + 3 * k;
    if (std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2])) at.payload_centre = v;
  }
  return at;
}

// Tips (n, 4, 4) of commanded joints (n, joints). Lanes are for stops of which nothing else is known.
template <class S, class Robot>
inline void poses_of(const Robot& r, const double* q, const Stops& stops, double* out, std::ptrdiff_t n) noexcept {
  constexpr std::ptrdiff_t together = side_by_side<S>;
  for (std::ptrdiff_t first = 0; first < n; first += together) {
    const std::ptrdiff_t count = n - first < together ? n - first : together;
    S x[Robot::capacity];
    for (int i = 0; i < r.joints; ++i) x[i] = gathered<S>(q + i, r.joints, first, count);
    const Frame<S> tip = forward(r, x, situation_of(r, stops, first));
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) scatter(tip.R[j][i], out + 4 * i + j, 16, first, count);
      scatter(tip.o[i], out + 4 * i + 3, 16, first, count);
    }
    for (std::ptrdiff_t k = first; k < first + count; ++k) {
      double* last = out + 16 * k + 12;
      last[0] = last[1] = last[2] = 0.0;
      last[3] = 1.0;
    }
  }
}

// Effective joints (n, joints) of commanded ones.
template <class S, class Robot>
inline void effective_of(const Robot& r, const double* q, const Stops& stops, double* out, std::ptrdiff_t n) noexcept {
  constexpr std::ptrdiff_t together = side_by_side<S>;
  for (std::ptrdiff_t first = 0; first < n; first += together) {
    const std::ptrdiff_t count = n - first < together ? n - first : together;
    S x[Robot::capacity], theta[Robot::capacity];
    for (int i = 0; i < r.joints; ++i) x[i] = gathered<S>(q + i, r.joints, first, count);
    effective(r, x, situation_of(r, stops, first), theta);
    for (int i = 0; i < r.joints; ++i) scatter(theta[i], out + i, r.joints, first, count);
  }
}

// Slopes of effective joints by commanded ones (n, joints, joints); their time derivatives where there are joint speeds dq,
// the stops before not known then.
template <class Robot>
inline void map_slopes_of(const Robot& r, const double* q, const double* dq, const Stops& stops, double* out,
                          std::ptrdiff_t n) noexcept {
  const auto row_of = [&r](const auto* x, const Situation& at, auto number, double* to) {
    using S = std::remove_const_t<std::remove_reference_t<decltype(*x)>>;
    S c[Robot::capacity], s[Robot::capacity], f[Robot::capacity], map[Robot::capacity][Robot::capacity];
    trigonometry(r, x, c, s);
    shift<true>(r, x, c, s, at, f, map);
    for (int i = 0; i < r.joints; ++i)
      for (int j = 0; j < r.joints; ++j) to[i * r.joints + j] = number(map[i][j], i == j ? 1.0 : 0.0);
  };
  for (std::ptrdiff_t row = 0; row < n; ++row) {
    double* const to = out + row * r.joints * r.joints;
    const double* const x = q + row * r.joints;
    if (dq == nullptr) {
      row_of(x, situation_of(r, stops, row), [](double slope, double same) { return slope + same; }, to);
      continue;
    }
    Dual moving[Robot::capacity];
    for (int i = 0; i < r.joints; ++i) moving[i] = {x[i], dq[row * r.joints + i]};
    row_of(moving, usual(r), [](const Dual& slope, double) { return slope.d; }, to);
  }
}

// Column j of a Jacobian along the axes of the base at the tip (0), along the tip's own (1), or of the point of the body
// that passes the origin (2).
template <class S, int capacity>
inline void column_of(const Frame<S>& tip, const S (&J)[6][capacity], int j, int reference, Vector<S>& linear,
                      Vector<S>& angular) noexcept {
  linear = { {J[0][j], J[1][j], J[2][j]} };
  angular = { {J[3][j], J[4][j], J[5][j]} };
  if (reference == 1) {
    linear = { {dot(tip.R[0], linear), dot(tip.R[1], linear), dot(tip.R[2], linear)} };
    angular = { {dot(tip.R[0], angular), dot(tip.R[1], angular), dot(tip.R[2], angular)} };
  } else if (reference == 2) {
    const Vector<S> more = cross(tip.o, angular);
    for (int k = 0; k < 3; ++k) linear[k] += more[k];
  }
}

// Jacobians (n, 6, joints).
template <class S, class Robot>
inline void jacobians_of(const Robot& r, const double* q, const Stops& stops, int reference, double* out,
                         std::ptrdiff_t n) noexcept {
  constexpr std::ptrdiff_t together = side_by_side<S>;
  for (std::ptrdiff_t first = 0; first < n; first += together) {
    const std::ptrdiff_t count = n - first < together ? n - first : together;
    S x[Robot::capacity], J[6][Robot::capacity];
    for (int i = 0; i < r.joints; ++i) x[i] = gathered<S>(q + i, r.joints, first, count);
    const Frame<S> tip = with_jacobian(r, x, situation_of(r, stops, first), J);
    for (int j = 0; j < r.joints; ++j) {
      Vector<S> linear, angular;
      column_of(tip, J, j, reference, linear, angular);
      for (int k = 0; k < 3; ++k) {
        scatter(linear[k], out + k * r.joints + j, 6 * r.joints, first, count);
        scatter(angular[k], out + (k + 3) * r.joints + j, 6 * r.joints, first, count);
      }
    }
  }
}

// Derivatives of Jacobians (n, 6, joints) along joint speeds dq (n, joints); the stops before are not known.
template <class Robot>
inline void rates_of(const Robot& r, const double* q, const double* dq, int reference, double* out, std::ptrdiff_t n) noexcept {
  for (std::ptrdiff_t row = 0; row < n; ++row) {
    Dual x[Robot::capacity], J[6][Robot::capacity];
    for (int i = 0; i < r.joints; ++i) x[i] = {q[row * r.joints + i], dq[row * r.joints + i]};
    const Frame<Dual> tip = with_jacobian(r, x, usual(r), J);
    double* to = out + 6 * r.joints * row;
    for (int j = 0; j < r.joints; ++j) {
      Vector<Dual> linear, angular;
      column_of(tip, J, j, reference, linear, angular);
      for (int k = 0; k < 3; ++k) {
        to[k * r.joints + j] = linear[k].d;
        to[(k + 3) * r.joints + j] = angular[k].d;
      }
    }
  }
}

template <class S>
inline Frame<S> frame_of(const double* T, std::ptrdiff_t first, std::ptrdiff_t count) noexcept {
  Frame<S> out;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) out.R[j][i] = gathered<S>(T + 4 * i + j, 16, first, count);
    out.o[i] = gathered<S>(T + 4 * i + 3, 16, first, count);
  }
  return out;
}

// Whether the last rows of poses are 0, 0, 0, 1.
template <class S>
inline auto last_row(const double* T, std::ptrdiff_t first, std::ptrdiff_t count, const S&) noexcept {
  S off = S{};
  for (int j = 0; j < 4; ++j) off += magnitude(gathered<S>(T + 12 + j, 16, first, count) - (j < 3 ? 0.0 : 1.0));
  return off <= 1e-6;
}

struct Wanted {  // arrays of poses and what becomes of them
  const double *T, *signs, *near;  // (n, 4, 4); (n, 3) or null: those of near, else all 1; (n, 6) or null
  double position, rotation;
  int stages;             // of search: how many are gone through
  double *q, *left;       // (n, 6), no numbers where none were found; errors of position and rotation of the best (2, n)
  std::int64_t* numbers;  // steps; branch, -1 without; method: 1, 2 where searched, 0 without; reason (4, n)
  bool* flags;            // converged; within the limits; in the branch asked for (3, n)
};
enum Reason : std::int64_t { converged, not_a_pose, bad_seed, out_of_reach, not_found };  // as in inverse/result.py

template <class S, class Robot>
inline void inverses_of(const Robot& r, const Wanted& w, std::ptrdiff_t n) noexcept {
  constexpr std::ptrdiff_t together = side_by_side<S>;
  for (std::ptrdiff_t first = 0; first < n; first += together) {
    const std::ptrdiff_t count = n - first < together ? n - first : together;
    S signs[3], near[6], there[3];
    const Frame<S> wanted = frame_of<S>(w.T, first, count);
    const auto pose = rigid(wanted) & last_row(w.T, first, count, S{});
    auto usable = pose;
    if (w.near != nullptr)
      for (int i = 0; i < 6; ++i) {
        near[i] = gathered<S>(w.near + i, 6, first, count);
        usable = usable & (magnitude(near[i]) < infinity);
      }
    for (int i = 0; i < 3; ++i) signs[i] = w.signs == nullptr ? all<S>(1.0) : gathered<S>(w.signs + i, 3, first, count);
    if (w.signs == nullptr && w.near != nullptr) branch_signs(r.closed, near, signs);
    const Solution<S> out =
        fixed_point(r, r.closed, wanted, signs, w.near == nullptr ? nullptr : near, r.reach, w.position, w.rotation);
    branch_signs(r.closed, out.q, there);
    const auto solved = usable & (out.position <= w.position) & (out.rotation <= w.rotation);
    auto done = solved;
    for (int i = 0; i < 6; ++i) {
      done = done & (out.q[i] >= r.lower[i] - limit_tolerance) & (out.q[i] <= r.upper[i] + limit_tolerance);
      scatter(out.q[i], w.q + i, 6, first, count);
    }
    scatter(out.position, w.left, 1, first, count);
    scatter(out.rotation, w.left + n, 1, first, count);
    const auto number = [](const auto* s) { return 0.5 * (7.0 - 4.0 * s[0] - 2.0 * s[1] - s[2]); };
    const auto as_number = [](const auto& condition) { return condition ? all<S>(1.0) : S{}; };
    const S each[7] = {out.steps, number(there), number(signs), as_number(done), as_number(solved), as_number(usable), as_number(pose)};
    for (std::ptrdiff_t k = 0; k < count; ++k) {
      double of[7];
      for (int i = 0; i < 7; ++i) of[i] = lane(each[i], k);
      std::int64_t* const numbers = w.numbers + first + k;
      bool* const flags = w.flags + first + k;
      bool good = of[4] != 0.0, searched = false, inside = of[3] != 0.0;
      numbers[3 * n] = converged;
      if (!inside) {
        double* const q = w.q + 6 * (first + k);
        Solution<double> one;
        std::copy(q, q + 6, one.q);
        one.position = one.rotation = not_a_number;
        one.steps = 0.0;
        numbers[3 * n] = of[6] != 0.0 ? bad_seed : not_a_pose;
        if (of[5] != 0.0) {
          double wanted_signs[3], signs_there[3];
          for (int i = 0; i < 3; ++i) wanted_signs[i] = lane(signs[i], k);
          one.position = lane(out.position, k);
          one.rotation = lane(out.rotation, k);
          one.margin = lane(out.margin, k);
          one.steps = of[0];
          const double* close = w.near == nullptr ? nullptr : w.near + 6 * (first + k);
          const Frame<double> target = frame_of<double>(w.T, first + k, 1);
          if (!good) good = searched = search(r, target, wanted_signs, close, w.stages, w.position, w.rotation, infinity, one);
          inside = good && (within_limits(r, one.q) || into_limits(r, target, close, w.position, w.rotation, one));
          if (good && !inside && !searched && w.stages > 1) {  // next to a singularity a branch has several solutions
            const double q5 = angle_of(r.closed, one.q, 4), apart = std::min(std::abs(radius_of(r.closed, one.q)), one.margin);
            const bool singular = std::abs(q5 - pi * std::nearbyint(q5 / pi)) < 0.1 || apart < 20.0 * r.difference;
            searched = search(r, target, wanted_signs, close, singular ? w.stages : 2, w.position, w.rotation, -2.0, one);
            inside = within_limits(r, one.q) || into_limits(r, target, close, w.position, w.rotation, one);
          }
          branch_signs(r.closed, one.q, signs_there);
          of[1] = number(signs_there);
          numbers[3 * n] = good ? converged : beyond(r, one.margin, one.position) ? out_of_reach : not_found;
        }
        for (int i = 0; i < 6; ++i) q[i] = good ? one.q[i] : not_a_number;
        w.left[first + k] = one.position;
        w.left[n + first + k] = one.rotation;
        of[0] = one.steps;
      }
      numbers[0] = static_cast<std::int64_t>(of[0]);
      numbers[n] = good ? static_cast<std::int64_t>(of[1]) : -1;
      numbers[2 * n] = good + searched;
      flags[0] = good;
      flags[n] = inside;
      flags[2 * n] = good && of[1] == of[2];
    }
  }
}

// Joints (8, 6, n), then distance from axis 1 and margins of reach in front and behind (3, n); which branches reach (8, n).
// Side by side are pairs of branches of one pose, which the flip of the wrist tells apart: that serves a single one, too.
template <class S, class Robot>
inline void branches_of(const Robot& r, const double* T, double* q, bool* valid, std::ptrdiff_t n) noexcept {
  constexpr std::ptrdiff_t pairs = 4, together = side_by_side<S>;
  const double front_of[pairs] = {1.0, 1.0, -1.0, -1.0}, up_of[pairs] = {1.0, -1.0, 1.0, -1.0};
  for (std::ptrdiff_t k = 0; k < n; ++k) {
    const Frame<S> wanted = frame_of<S>(T, k, 1);
    Hand<S> hand = hand_of(r.closed, wanted);
    const S off = rigid(wanted) & last_row(T, k, 1, S{}) ? S{} : all<S>(not_a_number);
    hand.radius += off;
    double* const places = q + 48 * n + k;
    places[0] = lane(hand.radius, 0);
    for (std::ptrdiff_t pair = 0; pair < pairs; pair += together) {
      const S front = gathered<S>(front_of, 1, pair, together), up = gathered<S>(up_of, 1, pair, together);
      S x[6], c23, s23, angle[3];
      const S margin = elbow(r.closed, hand, front, up, x, c23, s23);
      const S lost = margin >= -reach_tolerance ? S{} : all<S>(not_a_number);
      wrist(hand, front, c23, s23, angle);
      x[0] = joint_of(r.closed, 0, arc(hand.s1 * front, hand.c1 * front));
      for (int flip = 0; flip < 2; ++flip) {
        wrist_joints(r.closed, angle, all<S>(flip ? -1.0 : 1.0), x);
        for (int i = 0; i < 6; ++i) scatter(x[i] + lost, q + (6 * flip + i) * n + k, 12 * n, pair, together);
      }
      for (std::ptrdiff_t j = 0; j < together; ++j) {
        const std::ptrdiff_t first = 2 * (pair + j);
        valid[first * n + k] = valid[(first + 1) * n + k] = lane(lost, j) == 0.0;
        if (first % 4 == 0) places[(1 + first / 4) * n] = lane(margin, j);
      }
    }
  }
}

}  // namespace irbcal

#endif  // IRBCAL_KERNEL_HPP
