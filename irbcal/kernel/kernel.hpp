// Kinematics of calibrated serial arms: C++17, nothing but the standard library, no allocation, no exceptions.
//
// Every function takes a robot as data, any structure with the members that are used here, and a type of number: double
// for one pose, Lanes for four poses side by side. Sines,
// cosines and arcs are polynomials, so that both give the same numbers on every machine. Radians, metres, kilograms.
// Do not compile with -ffast-math.
#ifndef IRBCAL_KERNEL_HPP
#define IRBCAL_KERNEL_HPP

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

namespace irbcal {

// ------------------------------------------------------------------ numbers

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wpsabi"  // nothing here is called across objects
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
#if defined(__GNUC__)
inline LaneBits bits(const Lanes& x) noexcept { return (LaneBits)x; }
inline Lanes from_bits(const LaneBits& x) noexcept { return (Lanes)x; }
inline Lanes root(const Lanes& x) noexcept {
  double in[width], out[width];
  std::memcpy(in, &x, sizeof in);
#pragma omp simd
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

// Axes and origin of each joint's link after it has turned or slid; of the last one alone unless every is true.
template <bool every, class S, class Robot>
inline Frame<S> walk(const Robot& r, const Constant* chain, const S* q, const S* c, const S* s, Frame<S>* out) noexcept {
  Frame<S> F = at<S>(chain[0]);
  for (int i = 0; i < r.joints; ++i) {
    if (i > 0) step(F, chain[i]);
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

// Clenshaw's recurrences for the cosines and sines of a joint, two orders a turn; weighted: for their derivatives.
template <bool weighted, class S, class Robot>
inline void clenshaw(const Robot& r, int i, const S& c, S& a, S& a1, S& b, S& b1) noexcept {
  a = a1 = b = b1 = S{};
  const S twice = 2.0 * c;
  for (int k = r.orders; k > 0; k -= 2) {
    const double first = weighted ? k : 1.0, second = weighted ? k - 1 : 1.0;
    a1 = twice * a + (first * r.cosine[k - 1][i] - a1);
    b1 = twice * b + (first * r.sine[k - 1][i] - b1);
    a = twice * a1 + (second * r.cosine[k - 2][i] - a);
    b = twice * b1 + (second * r.sine[k - 2][i] - b);
  }
}

// f: what effective joints are more than commanded ones, without the last move; J: its derivative; c, s: of q.
template <bool slopes, class S, class Robot>
inline void still(const Robot& r, const S* q, const S* c, const S* s, double payload_kg, const double* centre, S* f,
                  S (*J)[Robot::capacity]) noexcept {
  for (int i = 0; i < r.joints; ++i) {
    f[i] = r.offset[i] + r.gain[i] * q[i];
    if constexpr (slopes)
      for (int j = 0; j < r.joints; ++j) J[i][j] = all<S>(i == j ? r.gain[i] : 0.0);
  }
  if (r.orders > 0)
    for (int i = 0; i < r.joints; ++i) {
      S u, u1, v, v1;
      clenshaw<false>(r, i, c[i], u, u1, v, v1);
      f[i] += u * c[i] - u1 + v * s[i];
      if constexpr (slopes) {
        clenshaw<true>(r, i, c[i], u, u1, v, v1);
        J[i][i] += v * c[i] - v1 - u * s[i];
      }
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
  if (r.levers > 0 || (r.has_payload && payload_kg != 0.0)) {
    Frame<S> w[Robot::capacity];
    walk<true>(r, r.nominal, q, c, s, w);
    weights<slopes>(r, w, payload_kg, centre, f, J);
  }
}

// ------------------------------------------------------------------ forward, with its derivative

// f: what effective joints are more than commanded ones, with the usual load; map: its slopes; c, s: of q.
// before: the stop before, where it is known (one pose only).
template <bool slopes, class S, class Robot>
inline void shift(const Robot& r, const S* q, const double* before, S* c, S* s, S* f, S (*map)[Robot::capacity]) noexcept {
  trigonometry(r, q, c, s);
  still<slopes>(r, q, c, s, r.payload_kg, r.payload_place, f, map);
  if constexpr (sizeof(S) == sizeof(double)) {
    if (before == nullptr || !r.has_history) return;
    double moves[Robot::capacity] = {};
    for (int i = 0; i < r.joints; ++i) {
      moves[i] = q[i] - before[i];
      if (!std::isfinite(moves[i])) return;
    }
    history<slopes>(r, moves, f, map);
  }
}

// The tip in the base for commanded joints, links on the way where slopes are wanted.
template <bool slopes, class S, class Robot>
inline Frame<S> forward(const Robot& r, const S* q, const double* before, S* theta, S (*map)[Robot::capacity],
                        Frame<S>* links) noexcept {
  S c[Robot::capacity], s[Robot::capacity], f[Robot::capacity];
  if (r.has_map) shift<slopes>(r, q, before, c, s, f, map);
  for (int i = 0; i < r.joints; ++i) theta[i] = r.has_map ? q[i] + f[i] : q[i];
  trigonometry(r, theta, c, s);
  Frame<S> tip = walk<slopes>(r, r.chain, theta, c, s, links);
  step(tip, r.tip);
  return tip;
}

// Derivative of the tip's place and rotation by the commanded joints, along the axes of the base.
template <class S, class Robot>
inline Frame<S> with_jacobian(const Robot& r, const S* q, const double* before, S (*J)[Robot::capacity]) noexcept {
  S theta[Robot::capacity], map[Robot::capacity][Robot::capacity], G[6][Robot::capacity];
  Frame<S> links[Robot::capacity];
  const Frame<S> tip = forward<true>(r, q, before, theta, map, links);
  for (int j = 0; j < r.joints; ++j) {
    const Vector<S> z = links[j].R[2], linear = r.slides[j] ? z : cross(z, minus(tip.o, links[j].o));
    for (int k = 0; k < 3; ++k) {
      G[k][j] = linear[k];
      G[k + 3][j] = r.slides[j] ? S{} : z[k];
    }
  }
  for (int i = 0; i < 6; ++i)
    for (int j = 0; j < r.joints; ++j) {
      J[i][j] = G[i][j];
      if (r.has_map)
        for (int k = 0; k < r.joints; ++k) J[i][j] += G[i][k] * map[k][j];
    }
  return tip;
}

// ------------------------------------------------------------------ the closed form of ortho-parallel arms

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
  const auto singular = s5 < 1e-12;
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

// Branch that joints lie in: -1 where behind axis 1, where down, where flipped, else 1.
template <class S>
inline void branch_signs(const ClosedForm& a, const S* q, S* signs) noexcept {
  S angle[6];
  for (int i = 0; i < 6; ++i) angle[i] = (q[i] - a.shifts[i]) * a.signs[i];
  S s2, c2, s23, c23;
  sine_cosine(angle[1], s2, c2);
  sine_cosine(angle[1] + angle[2], s23, c23);
  const S one = all<S>(1.0), radius = a.a2 + a.a3 * s2 + a.d4 * c23 + a.a4 * s23;
  signs[0] = radius < 0.0 ? -one : one;
  signs[1] = within_half_turn(a.signs[2] * (q[2] - a.bend)) < 0.0 ? -one : one;
  signs[2] = within_half_turn(angle[4]) < 0.0 ? -one : one;
}

// ------------------------------------------------------------------ the calibrated inverse

constexpr int iterations = 24;
constexpr double stalled = 0.5, slack = 0.05, reach_tolerance = 1e-12, limit_tolerance = 1e-9;

template <class S>
struct Solution {
  S q[6], position, rotation, margin, steps;
};

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
      const double lower = r.lower[i] - slack, upper = r.upper[i] + slack;
      auto stay = (q[i] >= lower) & (q[i] <= upper);
      S close = S{};
      if (near != nullptr) {
        close = near[i];
        stay = stay & (magnitude(close - q[i]) <= pi);
      }
      const S first = up_to_whole((most(all<S>(lower), all<S>(-1e6)) - q[i]) * (1.0 / tau));
      const S final = down_to_whole((least(all<S>(upper), all<S>(1e6)) - q[i]) * (1.0 / tau));
      const S turns = nearest_whole((close - q[i]) * (1.0 / tau));
      const S chosen = first <= final ? least(most(turns, first), final) : turns;
      q[i] = stay ? q[i] : q[i] + tau * chosen;
    }
    S theta[Robot::capacity];
    const Frame<S> tip = forward<false>(r, q, nullptr, theta, static_cast<S(*)[Robot::capacity]>(nullptr),
                                        static_cast<Frame<S>*>(nullptr));
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

struct Steps {  // of Newton's method; limits may be null
  double position, rotation;
  int straighten, patience;
  const double *lower, *upper;
};

template <class Robot>
struct Linear {
  double J[6][Robot::capacity], e[6], cost, position, rotation;
};

// What a step from q needs: lengths are over the reach.
template <class Robot>
inline void linearise(const Robot& r, const Frame<double>& wanted, double reach, const double* q, Linear<Robot>& out) noexcept {
  const Frame<double> tip = with_jacobian(r, q, nullptr, out.J);
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

// Adds a damped least-squares step, in which no joint moves by more than half a radian (or metre).
template <class Robot>
inline void damped_step(const Robot& r, const Linear<Robot>& at, const Steps& steps, double damping, double* q) noexcept {
  const int n = r.joints;
  double J[6][Robot::capacity], A[Robot::capacity][Robot::capacity], x[Robot::capacity];
  for (int j = 0; j < n; ++j) {
    double slope = 0.0;
    for (int k = 0; k < 6; ++k) slope += at.J[k][j] * at.e[k];
    const bool stuck = steps.lower != nullptr && ((q[j] <= steps.lower[j] && slope < 0.0) || (q[j] >= steps.upper[j] && slope > 0.0));
    for (int k = 0; k < 6; ++k) J[k][j] = stuck ? 0.0 : at.J[k][j];  // a joint that less error would lead beyond its limit
    x[j] = stuck ? 0.0 : slope;
  }
  for (int i = 0; i < n; ++i) {  // Cholesky's factor; the diagonal holds reciprocals
    for (int j = 0; j <= i; ++j) {
      double sum = i == j ? damping : 0.0;
      for (int k = 0; k < 6; ++k) sum += J[k][i] * J[k][j];
      for (int k = 0; k < j; ++k) sum -= A[i][k] * A[j][k];
      A[i][j] = i == j ? 1.0 / std::sqrt(std::max(sum, 1e-300)) : sum * A[j][j];
    }
    for (int k = 0; k < i; ++k) x[i] -= A[i][k] * x[k];
    x[i] *= A[i][i];
  }
  double longest = 0.5;
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k) x[i] -= A[k][i] * x[k];
    x[i] *= A[i][i];
    longest = std::max(longest, std::abs(x[i]));
  }
  for (int i = 0; i < n; ++i) q[i] += x[i] * (0.5 / longest);
}

// Levenberg-Marquardt from q, as irbcal.modeling.inverse.newton.solve; returns the number of evaluations.
template <class Robot>
inline int newton(const Robot& r, const Frame<double>& wanted, double reach, const Steps& steps, double* q, double& position,
                  double& rotation) noexcept {
  Linear<Robot> at, next;
  linearise(r, wanted, reach, q, at);
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
    damped_step(r, at, steps, damping * std::min(std::sqrt(at.cost), 1.0) + 1e-15, trial);
    linearise(r, wanted, reach, trial, next);
    for (int k = 0; k < steps.straighten; ++k) {
      damped_step(r, next, steps, 1e-5, trial);
      if (steps.lower != nullptr)
        for (int i = 0; i < r.joints; ++i) trial[i] = std::min(std::max(trial[i], steps.lower[i]), steps.upper[i]);
      linearise(r, wanted, reach, trial, next);
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

}  // namespace irbcal

#endif  // IRBCAL_KERNEL_HPP
