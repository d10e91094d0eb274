#include "splat.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <memory>
#include <stdexcept>

#include "parallel.h"
#include "splat_sort.h"
#include "splat_types.h"
#include "splat_view.h"

namespace coin3d {
namespace {

// Memory that only grows and is never cleared.
template <typename T>
class Buffer {
 public:
  T* at_least(int64_t n) {
    if (n > size_) {
      data_.reset();
      data_.reset(new T[n]);
      size_ = n;
    }
    return data_.get();
  }

 private:
  std::unique_ptr<T[]> data_;
  int64_t size_ = 0;
};

// What rendering one image needs; kept for the next one.
struct Workspace {
  std::vector<int64_t> chunks;
  std::vector<int64_t> visible;  // per chunk in `chunks`
  Buffer<SplatRecord> records;
  Buffer<uint32_t> depth_bits;
  Buffer<SplatKey> keys;
  std::vector<uint32_t> ends;  // per thread and tile: splat count, then where to write
  std::vector<SplatSorter> sorters;
};

// body(part) on as many threads; an exception in any of them is thrown again here.
template <typename Body>
void run_parts(int parts, const Body& body) {
  std::vector<std::exception_ptr> errors(parts);
  parallel_ranges(parts, parts, [&](int64_t first, int64_t last) {
    for (int64_t i = first; i < last; ++i) {
      try {
        body(static_cast<int>(i));
      } catch (...) {
        errors[i] = std::current_exception();
      }
    }
  });
  for (auto& e : errors)
    if (e) std::rethrow_exception(e);
}

struct Grid {
  int column_shift, row_shift;  // blocks to tiles
  int64_t columns, rows;

  Grid(const SplatKernel& kernel, const SplatCamera& camera)
      : column_shift(kernel.tile_columns_log2), row_shift(kernel.tile_rows_log2) {
    const int64_t width = int64_t{4} << column_shift, height = int64_t{1} << (kernel.block_height_log2 + row_shift);
    columns = (camera.width + width - 1) / width;
    rows = (camera.height + height - 1) / height;
  }

  // For every tile the splat touches: write(tile, counter[tile]), then count. Nearly all splats touch at most 2x2 tiles; those
  // take no branch: a tile that is named twice is written twice, the same into the same place, and counted once.
  template <typename Write>
  void each_tile(const SplatRecord& r, uint32_t* counter, const Write& write) const {
    const int64_t x = r.x0 >> column_shift, right = (r.x1 >> column_shift) - x;
    const int64_t y = r.y0 >> row_shift, down = (r.y1 >> row_shift) - y;
    const int64_t first = y * columns + x;
    if ((right | down) <= 1) {
      const int64_t tile[4] = {first + down * columns + right, first + down * columns, first + right, first};
      const int64_t touched[4] = {right & down, down, right, 1};
      const uint32_t count[4] = {counter[tile[0]], counter[tile[1]], counter[tile[2]], counter[tile[3]]};
      for (int k = 0; k < 4; ++k) {
        write(tile[k], count[k]);
        counter[tile[k]] = count[k] + static_cast<uint32_t>(touched[k]);
      }
      return;
    }
    for (int64_t j = 0; j <= down; ++j)
      for (int64_t i = 0; i <= right; ++i) {
        const int64_t tile = first + j * columns + i;
        write(tile, counter[tile]);
        ++counter[tile];
      }
  }
};

void render_one(const SplatScene& scene, const SplatCamera& camera, const SplatImage& image, int threads,
                const SplatKernel& kernel, Workspace& work) {
  const SplatView view = splat_view(camera);
  const Grid grid(kernel, camera);
  const int64_t tiles = grid.columns * grid.rows;

  work.chunks.clear();
  for (int64_t c = 0; c * kSplatChunk < scene.n; ++c)
    if (sees_chunk(view, scene.bounds + kSplatBounds * c)) work.chunks.push_back(c);
  const int64_t chunks = static_cast<int64_t>(work.chunks.size());
  work.visible.assign(chunks, 0);
  SplatRecord* records = work.records.at_least(chunks * kSplatChunk);
  uint32_t* depth_bits = work.depth_bits.at_least(chunks * kSplatChunk);
  work.ends.assign(static_cast<size_t>(threads) * tiles, 0);

  // Every chunk has 256 slots of its own, so slots follow the order of rows whoever fills them.
  run_parts(threads, [&](int t) {
    uint32_t* count = work.ends.data() + t * tiles;
    for (int64_t c = chunks * t / threads; c < chunks * (t + 1) / threads; ++c) {
      const int64_t first = work.chunks[c] * kSplatChunk, slot = c * kSplatChunk;
      const int64_t n = kernel.project(scene, first, std::min(kSplatChunk, scene.n - first), view, records + slot,
                                       depth_bits + slot);
      work.visible[c] = n;
      for (int64_t i = slot; i < slot + n; ++i) grid.each_tile(records[i], count, [](int64_t, uint32_t) {});
    }
  });

  std::vector<int64_t> tile_begin(tiles + 1);
  int64_t total = 0;
  for (int64_t tile = 0; tile < tiles; ++tile) {
    tile_begin[tile] = total;
    uint32_t within = 0;
    for (int t = 0; t < threads; ++t) {
      uint32_t& end = work.ends[t * tiles + tile];
      const uint32_t count = end;
      end = within;
      within += count;
    }
    total += within;
  }
  tile_begin[tiles] = total;
  SplatKey* keys = work.keys.at_least(total);

  run_parts(threads, [&](int t) {
    uint32_t* end = work.ends.data() + t * tiles;
    for (int64_t c = chunks * t / threads; c < chunks * (t + 1) / threads; ++c) {
      const int64_t slot = c * kSplatChunk;
      for (int64_t i = slot; i < slot + work.visible[c]; ++i) {
        const SplatKey key = static_cast<SplatKey>(depth_bits[i]) << 32 | static_cast<SplatKey>(i);
        grid.each_tile(records[i], end, [&](int64_t tile, uint32_t n) { keys[tile_begin[tile] + n] = key; });
      }
    }
  });

  work.sorters.resize(std::max<size_t>(work.sorters.size(), threads));
  std::atomic<int64_t> next{0};
  run_parts(threads, [&](int t) {
    for (int64_t i; (i = next.fetch_add(1)) < tiles;) {
      const int64_t n = tile_begin[i + 1] - tile_begin[i];
      SplatTile tile;
      tile.keys = work.sorters[t].sort(keys + tile_begin[i], n);
      tile.count = n;
      tile.records = records;
      tile.x0 = (i % grid.columns) * (int64_t{4} << kernel.tile_columns_log2);
      tile.y0 = (i / grid.columns) << (kernel.block_height_log2 + kernel.tile_rows_log2);
      tile.width = camera.width;
      tile.height = camera.height;
      tile.image = image;
      kernel.composite(tile);
    }
  });
}

const SplatKernel& find_kernel(const std::string& name) {
  for (const std::string& available : splat_instruction_sets()) {
    if (available != name) continue;
#ifdef COIN3D_SPLAT_X86
    if (name == kSplatAvx512.name) return kSplatAvx512;
    if (name == kSplatAvx2.name) return kSplatAvx2;
#endif
    return kSplatBaseline;
  }
  throw std::invalid_argument("this machine cannot run the instruction set '" + name + "'");
}

}  // namespace

std::vector<std::string> splat_instruction_sets() {
  std::vector<std::string> sets;
#ifdef COIN3D_SPLAT_X86
  const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
                    __builtin_cpu_supports("bmi2");
  const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  if (avx2 && avx512) sets.push_back(kSplatAvx512.name);
  if (avx2) sets.push_back(kSplatAvx2.name);
#endif
  sets.push_back(kSplatBaseline.name);
  return sets;
}

void splat_bounds(const float* centre, const float* std, int64_t n, float* bounds) {
  for (int64_t first = 0; first < n; first += kSplatChunk, bounds += kSplatBounds) {
    const int64_t last = std::min(n, first + kSplatChunk);
    float low[3], high[3], largest = 0, radius2 = 0;
    for (int k = 0; k < 3; ++k) low[k] = high[k] = centre[3 * first + k];
    for (int64_t i = first; i < last; ++i) {
      for (int k = 0; k < 3; ++k) {
        low[k] = std::min(low[k], centre[3 * i + k]);
        high[k] = std::max(high[k], centre[3 * i + k]);
      }
      largest = std::max(largest, std[i]);
    }
    for (int k = 0; k < 3; ++k) bounds[k] = 0.5f * low[k] + 0.5f * high[k];
    for (int64_t i = first; i < last; ++i) {
      float d2 = 0;
      for (int k = 0; k < 3; ++k) {
        const float d = centre[3 * i + k] - bounds[k];
        d2 += d * d;
      }
      radius2 = std::max(radius2, d2);
    }
    // grown by more than the rounding of centres and of their projection
    const float size = std::abs(bounds[0]) + std::abs(bounds[1]) + std::abs(bounds[2]);
    bounds[3] = std::sqrt(radius2) * 1.0001f + 1e-5f * size + 1e-4f;
    bounds[4] = largest;
  }
}

void splat_render(const SplatScene& scene, const std::vector<SplatCamera>& cameras, const std::vector<SplatImage>& images,
                  int threads, const std::string& instruction_set) {
  const SplatKernel& kernel = find_kernel(instruction_set);
  for (const SplatCamera& c : cameras)
    if (c.width > 4 * int64_t{kMaxBlocks} || c.height > int64_t{kMaxBlocks} << kernel.block_height_log2)
      throw std::invalid_argument("the image is too large: at most 65535 blocks per side");
  if (scene.n > int64_t{UINT32_MAX} - kSplatChunk) throw std::invalid_argument("more than four billion Gaussians");
  threads = std::max(1, threads);
  std::vector<Workspace> work(threads);
  // whole images on one thread each as long as they last, then the remaining ones on all threads
  const int64_t n = static_cast<int64_t>(cameras.size()), alone = n - n % threads;
  std::atomic<int64_t> next{0};
  if (alone)
    run_parts(threads, [&](int t) {
      for (int64_t i; (i = next.fetch_add(1)) < alone;) render_one(scene, cameras[i], images[i], 1, kernel, work[t]);
    });
  for (int64_t i = alone; i < n; ++i) render_one(scene, cameras[i], images[i], threads, kernel, work[0]);
}

}  // namespace coin3d
