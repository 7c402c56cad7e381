/* The control laws of drives.py and control.py, one simulation after the other: a result does not depend on its
   neighbours. Sums run in the order of the columns, so that it does not depend on the processor either. */
#ifdef __GNUC__
#pragma GCC optimize("O3")
#endif
#include <math.h>

typedef long long integer;
typedef unsigned char flag;

typedef struct {
  double period;                                 /* s, of control */
  double coriolis_share, coriolis_lost;          /* of a drive's torque */
  double gain, regularisation;                   /* of the mode */
  integer joints, base, first_angular, angulars; /* numbers of rates, and the place of angular ones in the base's */
  const double *torque_limit, *fastest, *acceleration_limit, *rates, *scale;
} Law;

/* fmin and fmax are calls, because of NaN. */
static inline double min(double a, double b) { return a < b ? a : b; }

static inline double max(double a, double b) { return a > b ? a : b; }

/* Replaces matrix (size, size; rows of `row` numbers) by the transpose of its Cholesky factor and the inverse of
   the factor's diagonal. */
static inline void factorise(integer size, double *matrix) {
  for (integer k = 0; k < size; ++k) {
    double *pivots = matrix + size * k, inverse = 1.0 / sqrt(pivots[k]);
    for (integer j = k + 1; j < size; ++j) pivots[j] *= inverse;
    pivots[k] = inverse;
    for (integer i = k + 1; i < size; ++i)
      for (integer j = i; j < size; ++j) matrix[size * i + j] -= pivots[i] * pivots[j];
  }
}

/* Replaces values (size, columns) by the solution, given the factors of the matrix. */
static inline void substitute(integer size, integer columns, const double *factors, double *values) {
  for (integer i = 0; i < size; ++i) {
    double *own = values + columns * i;
    for (integer j = 0; j < i; ++j)
      for (integer c = 0; c < columns; ++c) own[c] -= factors[size * j + i] * values[columns * j + c];
    for (integer c = 0; c < columns; ++c) own[c] *= factors[size * i + i];
  }
  for (integer i = size - 1; i >= 0; --i) {
    double *own = values + columns * i;
    for (integer j = i + 1; j < size; ++j)
      for (integer c = 0; c < columns; ++c) own[c] -= factors[size * i + j] * values[columns * j + c];
    for (integer c = 0; c < columns; ++c) own[c] *= factors[size * i + i];
  }
}

/* Copies the leading block (size, size) of a matrix with rows of `row` numbers, and factorises it. */
static inline void factors_of(integer size, const double *matrix, integer row, double *factors) {
  for (integer i = 0; i < size; ++i)
    for (integer j = 0; j < size; ++j) factors[size * i + j] = matrix[row * i + j];
  factorise(size, factors);
}

/* Joint torques (joints) for a generalised force (base + joints), which is overwritten: the base has none. */
static inline void eliminate(const Law *law, const double *mass, const double *factors, double *force,
                             double *torque) {
  integer base = law->base, row = base + law->joints;
  substitute(base, 1, factors, force);
  for (integer i = 0; i < law->joints; ++i) {
    double sum = force[base + i];
    for (integer j = 0; j < base; ++j) sum -= mass[row * (base + i) + j] * force[j];
    torque[i] = sum;
  }
}

/* Joint torques for joint accelerations at rest. */
static inline void inertial(const Law *law, const double *mass, const double *factors, const double *acceleration,
                            double *torque) {
  integer base = law->base, row = base + law->joints;
  double force[row];
  for (integer i = 0; i < row; ++i) {
    double sum = 0.0;
    for (integer j = 0; j < law->joints; ++j) sum += mass[row * i + base + j] * acceleration[j];
    force[i] = sum;
  }
  eliminate(law, mass, factors, force, torque);
}

/* Adds `need` to torques, times the largest factor up to 1 that keeps the torques' limits. */
static inline void add_within(const Law *law, double *torque, const double *need) {
  double factor = 1.0;
  for (integer i = 0; i < law->joints; ++i) {
    double sign = need[i] > 0.0 ? 1.0 : need[i] < 0.0 ? -1.0 : 0.0;
    double room = max(law->torque_limit[i] - torque[i] * sign, 0.0);
    factor = min(factor, room / max(fabs(need[i]), 1e-9));
  }
  for (integer i = 0; i < law->joints; ++i) torque[i] += need[i] * factor;
}

/* Torques (rows, joints) of `Drive.accelerate`. */
void accelerate(integer rows, const Law *law, const double *mass, const double *bias, const double *now,
                integer step, const double *acceleration, const flag *late, double *torque) {
  integer n = law->joints, base = law->base, row = base + n;
  double factors[base * base], force[row], need[n], held[n], other[n];
  for (; rows > 0; --rows, mass += row * row, bias += row, now += step, acceleration += n, late += n, torque += n) {
    factors_of(base, mass, row, factors);
    inertial(law, mass, factors, acceleration, need);
    for (integer i = 0; i < row; ++i) force[i] = bias[i];
    eliminate(law, mass, factors, force, held);
    double load = 0.0;
    int limited = 0, any_late = 0, fast = 0;
    for (integer i = 0; i < n; ++i) {
      double share = fabs(held[i]) / law->torque_limit[i];
      torque[i] = held[i] + need[i];
      load = max(load, share);
      any_late |= late[i];
      fast |= share > law->coriolis_share || fabs(now[i]) > law->fastest[i];
      limited |= fabs(torque[i]) > law->torque_limit[i];
    }
    if (!(limited || any_late || fast)) continue;
    if (fast) {
      for (integer i = 0; i < n; ++i) {
        other[i] = now[i] * (-1.0 / law->period);
        torque[i] = load > law->coriolis_lost ? 0.0 : held[i];
      }
      inertial(law, mass, factors, other, need);
    } else {
      for (integer i = 0; i < n; ++i) torque[i] = held[i];
      if (any_late) {
        double braking[n];
        for (integer i = 0; i < n; ++i) other[i] = late[i] ? acceleration[i] : 0.0;
        inertial(law, mass, factors, other, braking);
        add_within(law, torque, braking);
        for (integer i = 0; i < n; ++i) need[i] -= braking[i];
      }
    }
    add_within(law, torque, need);
    for (integer i = 0; i < n; ++i)
      torque[i] = min(max(torque[i], -law->torque_limit[i]), law->torque_limit[i]);
  }
}

/* Joint accelerations (rows, joints) from rest for joint torques. */
void forward(integer rows, const Law *law, const double *mass, const double *bias, const double *torque,
             double *acceleration) {
  integer n = law->joints, base = law->base, row = base + n;
  double factors[row * row], force[row];
  for (; rows > 0; --rows, mass += row * row, bias += row, torque += n, acceleration += n) {
    factors_of(row, mass, row, factors);
    for (integer i = 0; i < row; ++i) force[i] = i < base ? -bias[i] : torque[i - base] - bias[i];
    substitute(row, 1, factors, force);
    for (integer i = 0; i < n; ++i) acceleration[i] = force[base + i];
  }
}

/* Replaces rates by the nearest ones for which the base rotates at `base_rate`; only joints with `used` (joints)
   change, or all. */
static inline void project(const Law *law, const double *map, const double *base_rate, const flag *used,
                           double *rate) {
  integer n = law->joints, w = law->angulars;
  double square[w * w], error[w];
  for (integer i = 0; i < w; ++i) {
    double moved = 0.0;
    for (integer k = 0; k < n; ++k) moved += map[n * i + k] * rate[k];
    error[i] = base_rate[i] - moved;
    for (integer j = i; j < w; ++j) {
      double sum = 0.0;
      for (integer k = 0; k < n; ++k) sum += (used && !used[k]) ? 0.0 : map[n * i + k] * map[n * j + k];
      square[w * i + j] = i == j ? sum + law->regularisation : sum;
    }
  }
  factorise(w, square);
  substitute(w, 1, square, error);
  for (integer k = 0; k < n; ++k) {
    double change = 0.0;
    for (integer i = 0; i < w; ++i) change += map[n * i + k] * error[i];
    if (!used || used[k]) rate[k] += change;
  }
}

/* Joint accelerations (rows, joints) of mode reactionless, and whether a motion is too far from it, (rows). */
void reactionless(integer rows, const Law *law, const double *ahead, const double *attitude, integer attitude_step,
                  const double *now, integer step, const double *action, const double *low, const double *high,
                  const flag *late, double *acceleration, flag *away) {
  integer n = law->joints, base = law->base, row = base + n, w = law->angulars;
  double factors[base * base], solution[base * n], base_rate[w], present[n], rate[n];
  flag adjustable[n];
  const double *map = solution + n * law->first_angular;
  for (; rows > 0; --rows, ahead += base * row, attitude += attitude_step, now += step, action += n, low += n,
                   high += n, late += n, acceleration += n, ++away) {
    factors_of(base, ahead, row, factors);
    for (integer i = 0; i < base; ++i)
      for (integer k = 0; k < n; ++k) solution[n * i + k] = -ahead[row * i + base + k];
    substitute(base, n, factors, solution);
    for (integer i = 0; i < w; ++i) /* for small angles twice the vector part is the rotation vector */
      base_rate[i] = w == 1 ? -law->gain * attitude[0] : copysign(2.0 * law->gain, -attitude[0]) * attitude[1 + i];
    int any_late = 0;
    for (integer k = 0; k < n; ++k) rate[k] = min(max(action[k] * law->scale[k], low[k]), high[k]);
    project(law, map, base_rate, 0, rate);
    for (integer k = 0; k < n; ++k) {
      adjustable[k] = rate[k] >= low[k] && rate[k] <= high[k];
      rate[k] = min(max(rate[k], low[k]), high[k]);
      any_late |= late[k];
    }
    project(law, map, base_rate, adjustable, rate);
    double share = 1.0, largest = 1.0;
    for (integer k = 0; k < n; ++k)
      share = max(share, max(rate[k] / max(high[k], 1e-9), rate[k] / min(low[k], -1e-9)));
    for (integer k = 0; k < n; ++k) rate[k] = any_late ? 0.0 : rate[k] / share, present[k] = now[k];
    project(law, map, base_rate, 0, present);
    *away = 0;
    for (integer k = 0; k < n; ++k) {
      rate[k] = (rate[k] - present[k]) / law->period;
      largest = max(largest, fabs(rate[k]) / law->acceleration_limit[k]);
      *away |= max(present[k] - high[k], low[k] - present[k]) > law->rates[k];
    }
    for (integer k = 0; k < n; ++k) acceleration[k] = (present[k] - now[k]) / law->period + rate[k] / largest;
  }
}

/* Joint rates (rows, joints) for twists (rows, size) of end-effectors by the damped generalised Jacobian, slowed
   to the rate limits. Jacobians (rows, size, base + joints) are overwritten. */
void end_effectors(integer rows, const Law *law, integer size, const double *ahead, double *jacobian,
                   const double *action, double *rate) {
  integer n = law->joints, base = law->base, row = base + n;
  double factors[base * base], solution[base * n], square[size * size], twist[size];
  for (; rows > 0; --rows, ahead += base * row, jacobian += size * row, action += size, rate += n) {
    factors_of(base, ahead, row, factors);
    for (integer i = 0; i < base; ++i)
      for (integer k = 0; k < n; ++k) solution[n * i + k] = ahead[row * i + base + k];
    substitute(base, n, factors, solution);
    for (integer i = 0; i < size; ++i)
      for (integer j = 0; j < base; ++j)
        for (integer k = 0; k < n; ++k) jacobian[row * i + base + k] -= jacobian[row * i + j] * solution[n * j + k];
    for (integer i = 0; i < size; ++i) {
      for (integer j = i; j < size; ++j) {
        double sum = 0.0;
        for (integer k = 0; k < n; ++k) sum += jacobian[row * i + base + k] * jacobian[row * j + base + k];
        square[size * i + j] = sum;
      }
      square[size * i + i] += law->regularisation;
      twist[i] = action[i] * law->scale[i];
    }
    factorise(size, square);
    substitute(size, 1, square, twist);
    double excess = 1.0;
    for (integer k = 0; k < n; ++k) rate[k] = 0.0;
    for (integer i = 0; i < size; ++i)
      for (integer k = 0; k < n; ++k) rate[k] += jacobian[row * i + base + k] * twist[i];
    for (integer k = 0; k < n; ++k) excess = max(excess, fabs(rate[k]) / law->rates[k]);
    for (integer k = 0; k < n; ++k) rate[k] /= excess;
  }
}
