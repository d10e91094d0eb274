// Python bindings. Shapes and types are checked here; the functions behind trust their arguments.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <stdexcept>

#include "bev_pool.h"
#include "evaluation_bindings.h"
#include "rotated_boxes.h"
#include "scene_bindings.h"
#include "splat.h"

namespace nb = nanobind;
using namespace nb::literals;

template <typename T>
using Matrix = nb::ndarray<T, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
template <typename T>
using Vector = nb::ndarray<T, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

static void require(bool ok, const char* message) {
  if (!ok) throw std::invalid_argument(message);
}

static void check_cells(Matrix<const int32_t> cell, int64_t cells) {
  const int32_t* p = cell.data();
  for (size_t i = 0; i < cell.size(); ++i) require(p[i] < cells, "a cell index lies outside the grid");
}

static int64_t splat_chunks(size_t n) { return (static_cast<int64_t>(n) + coin3d::kSplatChunk - 1) / coin3d::kSplatChunk; }

// A camera is one row: rotation (9), position (3), two rows of K (6), slope limits (4), width, height.
static coin3d::SplatCamera splat_camera(const double* row) {
  coin3d::SplatCamera c;
  std::copy(row, row + 9, c.rotation);
  std::copy(row + 9, row + 12, c.position);
  std::copy(row + 12, row + 18, c.K);
  std::copy(row + 18, row + 22, c.limits);
  c.width = static_cast<int64_t>(row[22]);
  c.height = static_cast<int64_t>(row[23]);
  return c;
}

static void bind_splat(nb::module_& m) {
  m.attr("splat_chunk") = coin3d::kSplatChunk;
  m.def("splat_instruction_sets", &coin3d::splat_instruction_sets);
  m.def(
      "splat_bounds",
      [](Matrix<const float> centre, Vector<const float> std, Matrix<float> bounds) {
        require(centre.shape(1) == 3 && std.shape(0) == centre.shape(0), "centre and std differ in shape");
        require(static_cast<int64_t>(bounds.shape(0)) == splat_chunks(std.shape(0)) && bounds.shape(1) == coin3d::kSplatBounds,
                "wrong shape of bounds");
        nb::gil_scoped_release release;
        coin3d::splat_bounds(centre.data(), std.data(), std.shape(0), bounds.data());
      },
      "centre"_a, "std"_a, "bounds"_a);
  m.def(
      "splat_render",
      [](Matrix<const float> centre, Vector<const float> std, Matrix<const uint8_t> rgb, Matrix<const float> bounds,
         Matrix<const double> cameras, std::vector<nb::ndarray<uint8_t, nb::ndim<3>, nb::c_contig, nb::device::cpu>> images,
         std::vector<Matrix<float>> depths, std::vector<Matrix<float>> alphas, int threads,
         const std::string& instruction_set) {
        require(centre.shape(1) == 3 && std.shape(0) == centre.shape(0), "centre and std differ in shape");
        require(rgb.shape(0) == centre.shape(0) && rgb.shape(1) == 3, "centre and rgb differ in shape");
        require(static_cast<int64_t>(bounds.shape(0)) == splat_chunks(std.shape(0)) && bounds.shape(1) == coin3d::kSplatBounds,
                "wrong shape of bounds");
        require(cameras.shape(1) == 24, "a camera is a row of 24 numbers");
        const size_t n = cameras.shape(0);
        require(images.size() == n && depths.size() == n && alphas.size() == n, "one image, depth and alpha per camera");
        std::vector<coin3d::SplatCamera> views;
        std::vector<coin3d::SplatImage> outputs;
        for (size_t i = 0; i < n; ++i) {
          views.push_back(splat_camera(cameras.data() + 24 * i));
          const size_t w = views[i].width, h = views[i].height;
          require(images[i].shape(0) == h && images[i].shape(1) == w && images[i].shape(2) == 3, "wrong shape of an image");
          require(depths[i].shape(0) == h && depths[i].shape(1) == w, "wrong shape of a depth map");
          require(alphas[i].shape(0) == h && alphas[i].shape(1) == w, "wrong shape of an alpha map");
          outputs.push_back({images[i].data(), depths[i].data(), alphas[i].data()});
        }
        nb::gil_scoped_release release;
        coin3d::splat_render({centre.data(), std.data(), rgb.data(), bounds.data(), static_cast<int64_t>(std.shape(0))}, views,
                             outputs, threads, instruction_set);
      },
      "centre"_a, "std"_a, "rgb"_a, "bounds"_a, "cameras"_a, "images"_a, "depths"_a, "alphas"_a, "threads"_a,
      "instruction_set"_a);
}

NB_MODULE(_native, m) {
  coin3d::bind_scenes(m);
  coin3d::bind_evaluation(m);
  m.def(
      "bev_pool_forward",
      [](Matrix<const float> depth, Matrix<const float> context, Matrix<const int32_t> cell, Matrix<float> bev, int threads) {
        require(depth.shape(0) == context.shape(0), "depth and context have different numbers of pixels");
        require(depth.shape(0) == cell.shape(0) && depth.shape(1) == cell.shape(1), "depth and cell differ in shape");
        require(bev.shape(1) == context.shape(1), "bev and context have different numbers of channels");
        check_cells(cell, bev.shape(0));
        nb::gil_scoped_release release;
        coin3d::bev_pool_forward(depth.data(), context.data(), cell.data(), bev.data(), depth.shape(0), depth.shape(1),
                                 context.shape(1), bev.shape(0), threads);
      },
      "depth"_a, "context"_a, "cell"_a, "bev"_a, "threads"_a = 1);
  m.def(
      "bev_pool_backward",
      [](Matrix<const float> grad_bev, Matrix<const float> depth, Matrix<const float> context, Matrix<const int32_t> cell,
         Matrix<float> grad_depth, Matrix<float> grad_context, int threads) {
        require(depth.shape(0) == context.shape(0), "depth and context have different numbers of pixels");
        require(depth.shape(0) == cell.shape(0) && depth.shape(1) == cell.shape(1), "depth and cell differ in shape");
        require(grad_depth.shape(0) == depth.shape(0) && grad_depth.shape(1) == depth.shape(1), "wrong shape of grad_depth");
        require(grad_context.shape(0) == context.shape(0) && grad_context.shape(1) == context.shape(1),
                "wrong shape of grad_context");
        require(grad_bev.shape(1) == context.shape(1), "grad_bev and context have different numbers of channels");
        check_cells(cell, grad_bev.shape(0));
        nb::gil_scoped_release release;
        coin3d::bev_pool_backward(grad_bev.data(), depth.data(), context.data(), cell.data(), grad_depth.data(),
                                  grad_context.data(), depth.shape(0), depth.shape(1), context.shape(1), threads);
      },
      "grad_bev"_a, "depth"_a, "context"_a, "cell"_a, "grad_depth"_a, "grad_context"_a, "threads"_a = 1);
  m.def(
      "rotated_iou",
      [](Matrix<const double> a, Matrix<const double> b, Matrix<double> iou) {
        require(a.shape(1) == 5 && b.shape(1) == 5, "boxes have five columns: x, y, length, width, yaw");
        require(iou.shape(0) == a.shape(0) && iou.shape(1) == b.shape(0), "wrong shape of iou");
        for (size_t i = 0; i < a.shape(0); ++i)
          for (size_t j = 0; j < b.shape(0); ++j)
            iou.data()[i * b.shape(0) + j] = coin3d::rotated_iou(a.data() + 5 * i, b.data() + 5 * j);
      },
      "a"_a, "b"_a, "iou"_a);
  m.def(
      "rotated_nms",
      [](Matrix<const double> boxes, Vector<const int64_t> order, double iou_threshold) {
        require(boxes.shape(1) == 5, "boxes have five columns: x, y, length, width, yaw");
        for (size_t i = 0; i < order.shape(0); ++i)
          require(order.data()[i] >= 0 && order.data()[i] < static_cast<int64_t>(boxes.shape(0)), "order names a missing box");
        return coin3d::rotated_nms(boxes.data(), order.data(), static_cast<int64_t>(order.shape(0)), iou_threshold);
      },
      "boxes"_a, "order"_a, "iou_threshold"_a);
  bind_splat(m);
}
