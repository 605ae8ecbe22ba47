// Kinematics of a six-axis arm in plain C, one pose after another, for scripts/bench: a chain of constant frames, the
// closed form of ortho-parallel arms, and the fixed point of the calibrated inverse. Numbers are those of
// irbcal.modeling.term_sums.compiled and OrthoParallel.numbers. cc -O3 -march=native -shared -fPIC plain.c -lm
#include <math.h>
#include <string.h>

typedef struct { double R[3][3], p[3]; } Frame;
typedef struct { double a2, a3, d4, a4, bend, sign[6], shift[6]; double left[3][4], right[3][4]; } Arm;

static Frame from_rows(const double (*rows)[4]) {
  Frame F;
  for (int i = 0; i < 3; ++i) {
    memcpy(F.R[i], rows[i], 3 * sizeof(double));
    F.p[i] = rows[i][3];
  }
  return F;
}

static Frame product(Frame a, Frame b) {
  Frame out;
  for (int i = 0; i < 3; ++i) {
    out.p[i] = a.R[i][0] * b.p[0] + a.R[i][1] * b.p[1] + a.R[i][2] * b.p[2] + a.p[i];
    for (int j = 0; j < 3; ++j) out.R[i][j] = a.R[i][0] * b.R[0][j] + a.R[i][1] * b.R[1][j] + a.R[i][2] * b.R[2][j];
  }
  return out;
}

static Frame walk(const double (*chain)[3][4], const double* q, Frame* links) {
  Frame F;
  for (int i = 0; i < 6; ++i) {
    const Frame step = from_rows(chain[i]);
    F = i == 0 ? step : product(F, step);
    const double c = cos(q[i]), s = sin(q[i]);
    for (int k = 0; k < 3; ++k) {
      const double x = F.R[k][0], y = F.R[k][1];
      F.R[k][0] = c * x + s * y;
      F.R[k][1] = c * y - s * x;
    }
    if (links != 0) links[i] = F;
  }
  return product(F, from_rows(chain[6]));
}

static void write_pose(Frame F, double (*T)[4]) {
  for (int i = 0; i < 3; ++i) {
    memcpy(T[i], F.R[i], 3 * sizeof(double));
    T[i][3] = F.p[i];
    T[3][i] = 0.0;
  }
  T[3][3] = 1.0;
}

void forward(const double (*chain)[3][4], const double (*q)[6], double (*T)[4][4], long n) {
  for (long k = 0; k < n; ++k) write_pose(walk(chain, q[k], 0), T[k]);
}

void jacobians(const double (*chain)[3][4], const double (*q)[6], double (*J)[6][6], long n) {
  for (long k = 0; k < n; ++k) {
    Frame links[6];
    const Frame tip = walk(chain, q[k], links);
    for (int j = 0; j < 6; ++j) {
      const double z[3] = {links[j].R[0][2], links[j].R[1][2], links[j].R[2][2]};
      const double d[3] = {tip.p[0] - links[j].p[0], tip.p[1] - links[j].p[1], tip.p[2] - links[j].p[2]};
      for (int i = 0; i < 3; ++i) {
        J[k][i][j] = z[(i + 1) % 3] * d[(i + 2) % 3] - z[(i + 2) % 3] * d[(i + 1) % 3];
        J[k][i + 3][j] = z[i];
      }
    }
  }
}

static double within_half_turn(double x) { return x - 2.0 * M_PI * nearbyint(x / (2.0 * M_PI)); }
static double joint(const Arm* a, int j, double q) { return within_half_turn(a->sign[j] * q + a->shift[j]); }

// Joints of a branch; NaN beyond the reach.
static void branch(const Arm* a, Frame H, double front, double up, double straight, double* q) {
  const double radius = front * hypot(H.p[0], H.p[1]), c1 = H.p[0] / radius, s1 = H.p[1] / radius;
  const double k1 = radius - a->a2, k2 = H.p[2], L2 = a->a4 * a->a4 + a->d4 * a->d4, rho2 = k1 * k1 + k2 * k2;
  const double along = (rho2 - a->a3 * a->a3 - L2) / (2.0 * a->a3), across = up * sqrt(L2 - along * along);
  const double q2 = atan2(k1 * (along + a->a3) - k2 * across, k2 * (along + a->a3) + k1 * across);
  const double u = k1 - a->a3 * sin(q2), v = a->a3 * cos(q2) - k2;  // along the forearm
  const double c23 = (u * a->d4 - v * a->a4) / L2, s23 = (v * a->d4 + u * a->a4) / L2;
  double W[2][3];  // rows of the hand along the upper arm's plane and across
  for (int j = 0; j < 3; ++j) {
    W[0][j] = H.R[0][j] * c1 + H.R[1][j] * s1;
    W[1][j] = H.R[1][j] * c1 - H.R[0][j] * s1;
  }
  const double open = -H.R[2][2] * c23 - s23 * W[0][2], s5 = hypot(open, W[1][2]);
  const double q4 = atan2(straight * W[1][2], straight * open), c4 = cos(q4), s4 = sin(q4);
  q[0] = joint(a, 0, atan2(s1, c1));
  q[1] = joint(a, 1, q2);
  q[2] = within_half_turn(a->bend + a->sign[2] * atan2(across, along));
  q[3] = joint(a, 3, q4);
  q[4] = joint(a, 4, straight * atan2(s5, c23 * W[0][2] - s23 * H.R[2][2]));
  q[5] = joint(a, 5, atan2((W[0][0] * s23 + H.R[2][0] * c23) * s4 + W[1][0] * c4, (W[0][1] * s23 + H.R[2][1] * c23) * s4 + W[1][1] * c4));
}

static Frame hand(const Arm* a, Frame T) { return product(product(from_rows(a->left), T), from_rows(a->right)); }

void branches(const Arm* a, const double (*T)[4][4], double (*q)[8][6], long n) {
  for (long k = 0; k < n; ++k) {
    const Frame H = hand(a, from_rows(T[k]));
    for (int b = 0; b < 8; ++b) branch(a, H, b & 4 ? -1.0 : 1.0, b & 2 ? -1.0 : 1.0, b & 1 ? -1.0 : 1.0, q[k][b]);
  }
}

// The fixed point until place and rotation are within 1e-10 m and rad, at most 24 steps.
void inverses(const Arm* a, const double (*chain)[3][4], const double (*T)[4][4], const double (*signs)[3], double (*q)[6], long n) {
  for (long k = 0; k < n; ++k) {
    const Frame wanted = from_rows(T[k]);
    Frame fake = wanted;
    for (int step = 0; step < 24; ++step) {
      branch(a, hand(a, fake), signs[k][0], signs[k][1], signs[k][2], q[k]);
      const Frame tip = walk(chain, q[k], 0);
      double place = 0.0, chord = 0.0;
      Frame back;  // the inverse of the tip
      for (int i = 0; i < 3; ++i) {
        place += (wanted.p[i] - tip.p[i]) * (wanted.p[i] - tip.p[i]);
        back.p[i] = -(tip.R[0][i] * tip.p[0] + tip.R[1][i] * tip.p[1] + tip.R[2][i] * tip.p[2]);
        for (int j = 0; j < 3; ++j) {
          chord += (wanted.R[i][j] - tip.R[i][j]) * (wanted.R[i][j] - tip.R[i][j]);
          back.R[i][j] = tip.R[j][i];
        }
      }
      if (place <= 1e-20 && 0.5 * chord <= 1e-20) break;
      fake = product(fake, product(back, wanted));
    }
  }
}
