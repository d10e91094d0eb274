#include "scene_bindings.h"

#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include <optional>
#include <stdexcept>
#include <utility>

#include "marching_cubes.h"
#include "tsdf.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace coin3d {
namespace {

template <typename T>
using Rows3 = nb::ndarray<T, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
template <typename T>
using Vector = nb::ndarray<T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
template <typename T>
using Blocks = nb::ndarray<T, nb::shape<-1, kBlockSide, kBlockSide, kBlockSide>, nb::c_contig, nb::device::cpu>;

void require(bool ok, const char* message) {
  if (!ok) throw std::invalid_argument(message);
}

// A vector's memory as a numpy array of rows of three, without a copy.
template <typename T>
nb::ndarray<nb::numpy, T, nb::shape<-1, 3>> as_rows(std::vector<T>&& values) {
  auto* kept = new std::vector<T>(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return nb::ndarray<nb::numpy, T, nb::shape<-1, 3>>(kept->data(), {kept->size() / 3, 3}, owner);
}

}  // namespace

void bind_scenes(nb::module_& m) {
  nb::class_<TsdfVolume>(m, "TsdfVolume")
      .def(
          "__init__",
          [](TsdfVolume* self, double voxel_m, double truncation_m) {
            require(voxel_m > 0 && truncation_m >= voxel_m && truncation_m <= kMaxTruncation * voxel_m,
                    "voxels have a positive size and the truncation is 1 to 16 of them");
            new (self) TsdfVolume(voxel_m, truncation_m);
          },
          "voxel_m"_a, "truncation_m"_a)
      .def(
          "integrate",
          [](TsdfVolume& self, Rows3<const double> points, Rows3<const float> toward, std::optional<Vector<const float>> weight,
             int spread, int threads) {
            require(points.shape(0) == toward.shape(0), "points and directions differ in number");
            require(!weight || weight->shape(0) == points.shape(0), "points and weights differ in number");
            require(spread >= 0 && spread <= kMaxSpread, "spread is 0 to 3 voxels");
            nb::gil_scoped_release release;
            self.integrate(points.data(), toward.data(), weight ? weight->data() : nullptr, static_cast<int64_t>(points.shape(0)),
                           spread, threads);
          },
          "points"_a, "toward"_a, "weight"_a = nb::none(), "spread"_a = 0, "threads"_a = 1)
      .def(
          "field",
          [](const TsdfVolume& self, Rows3<int32_t> coords, Blocks<float> value, float min_weight, int threads) {
            require(static_cast<int64_t>(coords.shape(0)) == self.blocks() && coords.shape(0) == value.shape(0),
                    "coords and value need one row per block");
            nb::gil_scoped_release release;
            self.field(min_weight, coords.data(), value.data(), threads);
          },
          "coords"_a, "value"_a, "min_weight"_a, "threads"_a = 1)
      .def_prop_ro("blocks", &TsdfVolume::blocks)
      .def_prop_ro("bytes", &TsdfVolume::bytes);
  m.def(
      "marching_cubes",
      [](Rows3<const int32_t> coords, Blocks<const float> value, double voxel_m, int threads) {
        require(coords.shape(0) == value.shape(0), "coords and value need one row per block");
        Surface surface;
        {
          nb::gil_scoped_release release;
          surface = marching_cubes(coords.data(), value.data(), static_cast<int64_t>(coords.shape(0)), voxel_m, threads);
        }
        return std::make_pair(as_rows(std::move(surface.vertices)), as_rows(std::move(surface.faces)));
      },
      "coords"_a, "value"_a, "voxel_m"_a, "threads"_a = 1);
  m.def(
      "fill_holes",
      [](Rows3<const int32_t> coords, Blocks<const float> value, Blocks<float> filled, int threads) {
        require(coords.shape(0) == value.shape(0) && coords.shape(0) == filled.shape(0), "coords, value and filled differ in rows");
        nb::gil_scoped_release release;
        fill_holes(coords.data(), value.data(), static_cast<int64_t>(coords.shape(0)), filled.data(), threads);
      },
      "coords"_a, "value"_a, "filled"_a, "threads"_a = 1);
}

}  // namespace coin3d
