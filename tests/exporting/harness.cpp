// Rows of doubles in, rows of doubles out: -DHEADER, -DSPACE. With an argument: microseconds a call.
#include <chrono>
#include <cstdio>
#include <cstring>
#include <vector>

#include HEADER

using namespace SPACE;

template <class F>
double best(F call, int n) {
  double least = 1e9;
  for (int repetition = 0; repetition < 300; ++repetition) {
    const auto before = std::chrono::steady_clock::now();
    call();
    least = std::min(least, std::chrono::duration<double>(std::chrono::steady_clock::now() - before).count() / n);
  }
  return 1e6 * least;
}

struct Row {
  Joints q;
  Situation at;
};

int main(int arguments, char**) {
  constexpr int in = 3 * joints + 4;
  std::vector<Row> rows;
  double x[in];
  while (std::fread(x, sizeof(double), in, stdin) == in) {
    Row row;
    std::memcpy(row.q.data(), x, sizeof(Joints));
    std::memcpy(row.at.previous.data(), x + joints, sizeof(Joints));
    std::memcpy(row.at.torques.data(), x + 2 * joints, sizeof(Joints));
    row.at.previous_known = std::isfinite(x[joints]);
    row.at.payload_kg = x[3 * joints];
    std::memcpy(row.at.payload_centre.data(), x + 3 * joints + 1, sizeof(Vector));
    rows.push_back(row);
  }
  if (arguments > 1) {
    const int n = static_cast<int>(rows.size());
    std::vector<Pose> poses(rows.size());
    double sum = 0.0;
    const double fk = best([&] { for (int k = 0; k < n; ++k) poses[k] = forward(rows[k].q, rows[k].at); }, n);
    const double map = best([&] { for (int k = 0; k < n; ++k) { const Joints t = effective(rows[k].q, rows[k].at); for (double value : t) sum += value; } }, n);
    const double jac = best([&] { for (int k = 0; k < n; ++k) { Jacobian J; sum += forward(rows[k].q, rows[k].at, J).p[0] + J[5][0]; } }, n);
    int good = 0, steps = 0;
    const double ik = best([&] {
      good = steps = 0;
      for (int k = 0; k < n; ++k) {
        Joints seed = rows[k].q;
        for (int i = 0; i < joints; ++i) seed[i] += 0.01 * ((i + k) % 3 - 1);
        const Inverse found = inverse(poses[k], seed, rows[k].at);
        good += found.converged;
        steps += found.steps;
        sum += found.q[0];
      }
    }, n);
    std::printf("%.3f %.3f %.3f %.3f %.4f %.2f %g\n", fk, map, jac, ik, double(good) / n, double(steps) / n, sum * 0.0);
    return 0;
  }
  std::vector<double> together, tips(16 * rows.size());
  for (const Row& row : rows) together.insert(together.end(), row.q.begin(), row.q.end());
  forward(together.data(), tips.data(), static_cast<std::ptrdiff_t>(rows.size()));
  for (std::size_t k = 0; k < rows.size(); ++k) {  // the same bits as one by one
    const Pose usual = forward(rows[k].q);
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 4; ++j)
        if (std::abs(tips[16 * k + 4 * i + j] - (j < 3 ? usual.R[i][j] : usual.p[i])) > 1e-14) return 1;
  }
  for (const Row& row : rows) {
    JointMatrix M;
    Jacobian J;
    const Joints theta = effective(row.q, row.at, M);
    const Pose T = forward(row.q, row.at, J);
    Joints back{}, seed = row.q;
    const bool done = commanded(theta, back, row.at);
    for (int i = 0; i < joints; ++i) seed[i] += 0.02 * (i % 3 - 1);
    const Inverse close = inverse(T, seed, row.at);
    for (int i = 0; i < joints; ++i) seed[i] += data::has_closed_form ? 0.2 * (i % 3 - 1) : 0.0;
    Inverse found = inverse_near(T, seed, row.at);
    found.converged = found.converged && close.converged;
    const Pose again = forward(found.q, row.at);
    const double flags[2] = {done ? 1.0 : 0.0, found.converged ? 1.0 : 0.0};
    std::fwrite(theta.data(), sizeof(theta), 1, stdout);
    std::fwrite(T.R.data(), sizeof(T.R), 1, stdout);
    std::fwrite(T.p.data(), sizeof(T.p), 1, stdout);
    std::fwrite(M.data(), sizeof(M), 1, stdout);
    std::fwrite(J.data(), sizeof(J), 1, stdout);
    std::fwrite(back.data(), sizeof(back), 1, stdout);
    std::fwrite(again.R.data(), sizeof(again.R), 1, stdout);
    std::fwrite(again.p.data(), sizeof(again.p), 1, stdout);
    std::fwrite(flags, sizeof(flags), 1, stdout);
  }
}
