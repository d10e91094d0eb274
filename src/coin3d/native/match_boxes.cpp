#include "match_boxes.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "parallel.h"

namespace coin3d {
namespace {

// Objects of one sample, those of a label side by side and in the order of their rows.
struct Objects {
  std::vector<double> x, y;
  std::vector<int32_t> row;
  std::vector<int64_t> begin;  // labels + 1
  std::vector<uint8_t> taken;  // thresholds x objects

  void load(const BoxColumns& all, int64_t group, int labels, int num_thresholds) {
    const int64_t first = all.start[group], last = all.start[group + 1];
    begin.assign(labels + 1, 0);
    for (int64_t i = first; i < last; ++i)
      if (all.label[i] >= 0) ++begin[all.label[i] + 1];
    for (int l = 0; l < labels; ++l) begin[l + 1] += begin[l];
    const size_t n = begin[labels];
    x.resize(n);
    y.resize(n);
    row.resize(n);
    taken.assign(n * num_thresholds, 0);
    std::vector<int64_t> next(begin.begin(), begin.end() - 1);
    for (int64_t i = first; i < last; ++i) {
      if (all.label[i] < 0) continue;
      const int64_t at = next[all.label[i]]++;
      x[at] = all.centre[3 * i];
      y[at] = all.centre[3 * i + 1];
      row[at] = static_cast<int32_t>(i);
    }
  }
};

struct Near {
  int64_t object;
  double distance;
};

}  // namespace

void match_boxes(const BoxColumns& detections, const double* score, const int64_t* sample_of_group, const BoxColumns& objects,
                 int labels, const double* thresholds, int num_thresholds, int32_t* matched, int threads) {
  const int64_t rows = detections.start[detections.groups];
  double reach = 0;
  for (int t = 0; t < num_thresholds; ++t) reach = std::max(reach, thresholds[t]);
  const double reach_squared = reach * reach * (1 + 1e-9);  // a sieve; the distance itself decides
  std::fill(matched, matched + rows * num_thresholds, -1);
  parallel_ranges(detections.groups, threads, [&](int64_t from, int64_t to) {
    Objects sample;
    std::vector<int64_t> order;
    std::vector<Near> near;
    for (int64_t g = from; g < to; ++g) {
      sample.load(objects, sample_of_group[g], labels, num_thresholds);
      if (sample.row.empty()) continue;
      order.clear();
      for (int64_t i = detections.start[g]; i < detections.start[g + 1]; ++i)
        if (detections.label[i] >= 0 && sample.begin[detections.label[i]] < sample.begin[detections.label[i] + 1])
          order.push_back(i);
      std::sort(order.begin(), order.end(),
                [&](int64_t a, int64_t b) { return score[a] > score[b] || (score[a] == score[b] && a > b); });
      for (const int64_t i : order) {
        const double px = detections.centre[3 * i], py = detections.centre[3 * i + 1];
        near.clear();
        for (int64_t k = sample.begin[detections.label[i]]; k < sample.begin[detections.label[i] + 1]; ++k) {
          const double dx = sample.x[k] - px, dy = sample.y[k] - py, squared = dx * dx + dy * dy;
          if (squared < reach_squared) near.push_back({k, std::sqrt(squared)});
        }
        if (near.empty()) continue;
        for (int t = 0; t < num_thresholds; ++t) {
          uint8_t* taken = sample.taken.data() + t * sample.row.size();
          int64_t best = -1;
          double best_distance = thresholds[t];
          for (const Near& n : near)
            if (n.distance < best_distance && !taken[n.object]) {
              best = n.object;
              best_distance = n.distance;
            }
          if (best < 0) continue;
          taken[best] = 1;
          matched[t * rows + i] = sample.row[best];
        }
      }
    }
  });
}

}  // namespace coin3d
