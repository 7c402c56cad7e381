/* First contacts of capsules in a control period, one episode after the other. The mathematics is that of
   capsules.py and spheres.py, but capsules whose bounding boxes are apart need no closer check. */
#include <math.h>

typedef long long integer;
typedef double vector[3];

enum { SHARES = 9 }; /* of a period, at which links are checked */

typedef struct { /* points of the arms at the beginning and at the end of a period */
  const vector *before, *after;
} Motion;

typedef struct {
  vector low, high;
} Box;

/* fmin and fmax are calls, because of NaN. */
static double min(double a, double b) { return a < b ? a : b; }

static double max(double a, double b) { return a > b ? a : b; }

static void at_share(Motion motion, integer point, integer share, double *place) {
  double remaining = 1.0 - share / (SHARES - 1.0);
  for (int i = 0; i < 3; ++i) {
    double after = motion.after[point][i];
    place[i] = after - remaining * (after - motion.before[point][i]);
  }
}

static void bounding_boxes(integer count, const integer *start, const integer *end, Motion motion, Box *boxes) {
  for (integer k = 0; k < count; ++k)
    for (int i = 0; i < 3; ++i) {
      double a = motion.before[start[k]][i], b = motion.before[end[k]][i];
      double c = motion.after[start[k]][i], d = motion.after[end[k]][i];
      boxes[k].low[i] = min(min(a, b), min(c, d));
      boxes[k].high[i] = max(max(a, b), max(c, d));
    }
}

static int apart(const Box *one, const Box *other, double distance) {
  for (int i = 0; i < 3; ++i)
    if (one->low[i] - other->high[i] > distance || other->low[i] - one->high[i] > distance) return 1;
  return 0;
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static double clip(double share) { return min(max(share, 0.0), 1.0); }

static double point_segment(const double *point, const double *a, const double *b, double least) {
  vector along, from, gap;
  for (int i = 0; i < 3; ++i) along[i] = b[i] - a[i], from[i] = point[i] - a[i];
  double share = clip(dot(from, along) / max(dot(along, along), least));
  for (int i = 0; i < 3; ++i) gap[i] = from[i] - share * along[i];
  return sqrt(dot(gap, gap));
}

static double segment_distance(const double *a, const double *b, const double *c, const double *d) {
  double least = min(min(point_segment(a, c, d, 1e-300), point_segment(b, c, d, 1e-300)),
                      min(point_segment(c, a, b, 1e-300), point_segment(d, a, b, 1e-300)));
  vector u, v, w, gap;
  for (int i = 0; i < 3; ++i) u[i] = b[i] - a[i], v[i] = d[i] - c[i], w[i] = a[i] - c[i];
  double uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), uw = dot(u, w), vw = dot(v, w);
  double square = uu * vv - uv * uv;
  if (!(square > 1e-12 * uu * vv)) return least;
  double s = (uv * vw - vv * uw) / square, t = (uu * vw - uv * uw) / square;
  if (!(s >= 0.0 && s <= 1.0 && t >= 0.0 && t <= 1.0)) return least;
  for (int i = 0; i < 3; ++i) gap[i] = w[i] + s * u[i] - t * v[i];
  return sqrt(dot(gap, gap));
}

/* Bound on how much the distance of a capsule from anything shrinks in a period. */
static double displacement(Motion motion, integer start, integer end) {
  vector a, b;
  for (int i = 0; i < 3; ++i) {
    a[i] = motion.after[start][i] - motion.before[start][i];
    b[i] = motion.after[end][i] - motion.before[end][i];
  }
  return sqrt(max(dot(a, a), dot(b, b)));
}

/* Distance of the segment from a to b from a box, 0 where they meet. */
static double box_distance(const double *a, const double *b, const double *half) {
  double low = 0.0, high = 1.0, before = -INFINITY, after = INFINITY;
  vector along, outside;
  for (int i = 0; i < 3; ++i) along[i] = b[i] - a[i];
  for (int k = 0; k < 8; ++k) { /* where the line crosses the planes of the faces, and both ends */
    int axis = k / 2;
    double slope = 0.0, share = k - 6.0;
    if (axis < 3) {
      double safe = fabs(along[axis]) > 1e-300 ? along[axis] : 1e-300;
      share = clip(((k % 2 ? -half[axis] : half[axis]) - a[axis]) / safe);
    }
    for (int i = 0; i < 3; ++i) {
      double place = a[i] + share * along[i];
      slope += copysign(max(fabs(place) - half[i], 0.0), place) * along[i];
    }
    if (slope <= 0.0) low = max(low, share), before = max(before, slope);
    if (slope >= 0.0) high = min(high, share), after = min(after, slope);
  }
  if (before < 0.0 && isfinite(before) && isfinite(after)) low += (high - low) * -before / (after - before);
  for (int i = 0; i < 3; ++i) outside[i] = max(fabs(a[i] + low * along[i]) - half[i], 0.0);
  return sqrt(dot(outside, outside));
}

/* The functions below lower `first`, the earliest contact of each row as share * pairs + pair, to that of count
   capsules with a body; `pair` is the first capsule's number. The points of the arms are among the sensors
   (rows, width) from a column on; start, end (count) are the places of the capsules' ends among them. Capsules
   with a negative radius are not checked. */

/* Contacts with a box: of half sides `shape` times the width that the sensors have from a column on, if any. */
void box_contacts(integer rows, integer width, const double *before, const double *after, integer *first,
                  integer pairs, integer pair, integer column, integer count, const integer *start,
                  const integer *end, const double *radius, const double *centre, const double *shape,
                  integer width_column) {
  Box boxes[count + 1], body;
  vector half;
  for (; rows > 0; --rows, before += width, after += width, ++first) {
    Motion motion = {(const vector *)(before + column), (const vector *)(after + column)};
    const double *seen = after + width_column;
    double size = width_column < 0 ? 1.0 : max(max(fabs(seen[0]), fabs(seen[1])), fabs(seen[2]));
    for (int i = 0; i < 3; ++i) {
      half[i] = size * shape[i];
      body.low[i] = centre[i] - half[i], body.high[i] = centre[i] + half[i];
    }
    bounding_boxes(count, start, end, motion, boxes);
    for (integer k = 0; k < count; ++k) {
      if (radius[k] < 0.0 || apart(&boxes[k], &body, radius[k])) continue;
      double near = radius[k] + displacement(motion, start[k], end[k]);
      for (integer share = SHARES - 1; share >= 0; --share) {
        vector a, b;
        at_share(motion, start[k], share, a);
        at_share(motion, end[k], share, b);
        for (int i = 0; i < 3; ++i) a[i] -= centre[i], b[i] -= centre[i];
        double distance = box_distance(a, b, half);
        if (distance > near) break;
        integer rank = share * pairs + pair + k;
        if (distance <= radius[k] && rank < *first) *first = rank;
      }
    }
  }
}

/* Contacts of the first `split` capsules with the others, closer than `reach` (split, count - split). */
void arm_contacts(integer rows, integer width, const double *before, const double *after, integer *first,
                  integer pairs, integer pair, integer column, integer count, const integer *start,
                  const integer *end, integer split, const double *reach) {
  Box boxes[count + 1];
  for (; rows > 0; --rows, before += width, after += width, ++first) {
    Motion motion = {(const vector *)(before + column), (const vector *)(after + column)};
    bounding_boxes(count, start, end, motion, boxes);
    for (integer k = 0; k < split * (count - split); ++k) {
      integer one = k / (count - split), other = split + k % (count - split);
      if (reach[k] < 0.0 || apart(&boxes[one], &boxes[other], reach[k])) continue;
      double near = reach[k] + displacement(motion, start[one], end[one]);
      near += displacement(motion, start[other], end[other]);
      for (integer share = SHARES - 1; share >= 0; --share) {
        vector a, b, c, d;
        at_share(motion, start[one], share, a);
        at_share(motion, end[one], share, b);
        at_share(motion, start[other], share, c);
        at_share(motion, end[other], share, d);
        double distance = segment_distance(a, b, c, d);
        if (distance > near) break;
        integer rank = share * pairs + pair + k;
        if (distance <= reach[k] && rank < *first) *first = rank;
      }
    }
  }
}

/* Contacts with spheres at rest, by the columns (4 * spheres) of their centres and radii. */
void sphere_contacts(integer rows, integer width, const double *before, const double *after, integer *first,
                     integer pairs, integer pair, integer column, integer count, const integer *start,
                     const integer *end, const double *radius, integer spheres, const integer *columns) {
  Box boxes[count + 1], centre;
  for (; rows > 0; --rows, before += width, after += width, ++first) {
    Motion motion = {(const vector *)(before + column), (const vector *)(after + column)};
    bounding_boxes(count, start, end, motion, boxes);
    for (integer k = 0; k < count * spheres; ++k) {
      integer link = k / spheres, sphere = k % spheres;
      double size = after[columns[3 * spheres + sphere]];
      for (int i = 0; i < 3; ++i) centre.low[i] = centre.high[i] = after[columns[3 * sphere + i]];
      if (apart(&boxes[link], &centre, radius[link] + size)) continue;
      double near = displacement(motion, start[link], end[link]);
      for (integer share = SHARES - 1; share >= 0; --share) {
        vector a, b;
        at_share(motion, start[link], share, a);
        at_share(motion, end[link], share, b);
        double gap = point_segment(centre.low, a, b, 1e-12) - size - radius[link];
        if (gap > near) break;
        integer rank = share * pairs + pair + k;
        if (gap <= 0.0 && rank < *first) *first = rank;
      }
    }
  }
}
