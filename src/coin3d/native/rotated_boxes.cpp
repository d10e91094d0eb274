#include "rotated_boxes.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace coin3d {
namespace {

struct Point {
  double x, y;
};

// Clipping a rectangle by four half-planes adds at most one vertex each.
struct Polygon {
  std::array<Point, 8> vertex;
  int size = 0;
  void add(Point p) {
    if (size < 8) vertex[size++] = p;
  }
};

Polygon corners(const double* box) {
  const double c = std::cos(box[4]), s = std::sin(box[4]), l = box[2] / 2, w = box[3] / 2;
  Polygon out;
  for (auto [sl, sw] : {std::pair{1, 1}, {-1, 1}, {-1, -1}, {1, -1}})
    out.add({box[0] + sl * l * c - sw * w * s, box[1] + sl * l * s + sw * w * c});
  return out;
}

// Keep the part on the left of the directed line a -> b (Sutherland-Hodgman).
Polygon clip(const Polygon& in, Point a, Point b) {
  auto side = [&](Point p) { return (b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x); };
  Polygon out;
  for (int i = 0; i < in.size; ++i) {
    const Point p = in.vertex[i], q = in.vertex[(i + 1) % in.size];
    const double sp = side(p), sq = side(q);
    if (sp >= 0) out.add(p);
    if ((sp > 0 && sq < 0) || (sp < 0 && sq > 0)) {
      const double t = sp / (sp - sq);
      out.add({p.x + t * (q.x - p.x), p.y + t * (q.y - p.y)});
    }
  }
  return out;
}

double area(const Polygon& p) {
  double twice = 0;
  for (int i = 0; i < p.size; ++i) {
    const Point a = p.vertex[i], b = p.vertex[(i + 1) % p.size];
    twice += a.x * b.y - b.x * a.y;
  }
  return std::max(0.0, twice / 2);
}

}  // namespace

double rotated_iou(const double* a, const double* b) {
  const double dx = b[0] - a[0], dy = b[1] - a[1];
  const double reach = (std::hypot(a[2], a[3]) + std::hypot(b[2], b[3])) / 2;
  if (dx * dx + dy * dy > reach * reach) return 0;
  // around the first centre, so that boxes far from the origin lose no digits
  const double a0[5] = {0, 0, a[2], a[3], a[4]}, b0[5] = {dx, dy, b[2], b[3], b[4]};
  Polygon overlap = corners(a0);
  const Polygon window = corners(b0);
  for (int i = 0; i < 4 && overlap.size; ++i) overlap = clip(overlap, window.vertex[i], window.vertex[(i + 1) % 4]);
  const double common = area(overlap), together = a[2] * a[3] + b[2] * b[3] - common;
  return together > 0 ? common / together : 0;  // boxes without area overlap nothing
}

std::vector<int64_t> rotated_nms(const double* boxes, const int64_t* order, int64_t n, double iou_threshold) {
  std::vector<int64_t> kept;
  for (int64_t i = 0; i < n; ++i) {
    const double* box = boxes + 5 * order[i];
    const bool clear = std::none_of(kept.begin(), kept.end(),
                                    [&](int64_t k) { return rotated_iou(boxes + 5 * k, box) >= iou_threshold; });
    if (clear) kept.push_back(order[i]);
  }
  return kept;
}

}  // namespace coin3d
