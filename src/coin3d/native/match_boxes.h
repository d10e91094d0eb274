// Greedy matching of detections to objects by centre distance, sample by sample.
#pragma once
#include <cstdint>

namespace coin3d {

// Boxes of several samples, one sample after another: those of group g are the rows start[g] .. start[g + 1] - 1.
struct BoxColumns {
  const double* centre;   // n rows of x, y, z; z is not read
  const int16_t* label;   // n; negative: takes no part
  const int64_t* start;   // groups + 1
  int64_t groups;
};

// In order of falling score (of equal scores the later row first) each detection takes the nearest object of its label and
// sample that is still free, if it is nearer than the threshold; of equally near objects the first row. Thresholds do not
// influence each other. `sample_of_group` names the group of `objects` that a group of `detections` belongs to.
// matched: one row per threshold, for every detection the row of its object or -1.
void match_boxes(const BoxColumns& detections, const double* score, const int64_t* sample_of_group, const BoxColumns& objects,
                 int labels, const double* thresholds, int num_thresholds, int32_t* matched, int threads);

}  // namespace coin3d
