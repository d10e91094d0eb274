#include "evaluation_bindings.h"

#include <nanobind/ndarray.h>

#include <cstddef>
#include <limits>
#include <stdexcept>

#include "match_boxes.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace coin3d {
namespace {

template <typename T>
using Rows3 = nb::ndarray<T, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
template <typename T>
using Matrix = nb::ndarray<T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
template <typename T>
using Vector = nb::ndarray<T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

void require(bool ok, const char* message) {
  if (!ok) throw std::invalid_argument(message);
}

BoxColumns columns(Rows3<const double> centre, Vector<const int16_t> label, Vector<const int64_t> start, int labels) {
  require(label.shape(0) == centre.shape(0), "centres and labels differ in number");
  require(start.shape(0) >= 1 && start.data()[0] == 0, "the first group starts at row 0");
  const int64_t groups = static_cast<int64_t>(start.shape(0)) - 1;
  for (int64_t g = 0; g < groups; ++g) require(start.data()[g] <= start.data()[g + 1], "groups overlap");
  require(start.data()[groups] == static_cast<int64_t>(centre.shape(0)), "the last group ends with the last row");
  for (size_t i = 0; i < label.shape(0); ++i) require(label.data()[i] < labels, "a label lies beyond the classes");
  return {centre.data(), label.data(), start.data(), groups};
}

}  // namespace

void bind_evaluation(nb::module_& m) {
  m.def(
      "match_boxes",
      [](Rows3<const double> centre, Vector<const double> score, Vector<const int16_t> label, Vector<const int64_t> start,
         Vector<const int64_t> sample_of_group, Rows3<const double> object_centre, Vector<const int16_t> object_label,
         Vector<const int64_t> object_start, int labels, Vector<const double> thresholds, Matrix<int32_t> matched, int threads) {
        require(labels >= 0, "a negative number of labels");
        const BoxColumns detections = columns(centre, label, start, labels);
        const BoxColumns objects = columns(object_centre, object_label, object_start, labels);
        require(score.shape(0) == centre.shape(0), "centres and scores differ in number");
        require(static_cast<int64_t>(sample_of_group.shape(0)) == detections.groups, "one sample per group of detections");
        for (int64_t g = 0; g < detections.groups; ++g)
          require(sample_of_group.data()[g] >= 0 && sample_of_group.data()[g] < objects.groups, "a sample without objects' group");
        require(object_centre.shape(0) <= std::numeric_limits<int32_t>::max(), "too many objects");
        require(matched.shape(0) == thresholds.shape(0) && matched.shape(1) == centre.shape(0), "wrong shape of matched");
        nb::gil_scoped_release release;
        match_boxes(detections, score.data(), sample_of_group.data(), objects, labels, thresholds.data(),
                    static_cast<int>(thresholds.shape(0)), matched.data(), threads);
      },
      "centre"_a, "score"_a, "label"_a, "start"_a, "sample_of_group"_a, "object_centre"_a, "object_label"_a, "object_start"_a,
      "labels"_a, "thresholds"_a, "matched"_a, "threads"_a = 1);
}

}  // namespace coin3d
