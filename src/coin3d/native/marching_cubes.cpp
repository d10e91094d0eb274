#include "marching_cubes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "block_map.h"
#include "cube_cases.h"
#include "parallel.h"

namespace coin3d {
namespace {

constexpr int kEdges = 3 * kBlockVoxels;  // a block owns the three lattice edges that leave each of its voxels upwards
constexpr int kWords = kEdges / 64;
constexpr int kHalo = kBlockSide + 2;
// A vertex this near to a voxel centre would coincide with its neighbours on other edges.
constexpr float kMinShare = 1e-3f;

BlockMap map_of(const int32_t* coords, int64_t blocks) {
  BlockMap map;
  for (int64_t r = 0; r < blocks; ++r) {
    for (int a = 0; a < 3; ++a)
      if (std::abs(int64_t{coords[3 * r + a]}) > kMaxBlock) throw std::invalid_argument("a block lies too far from the origin");
    map.insert(block_key(coords[3 * r], coords[3 * r + 1], coords[3 * r + 2]));
    if (map.size() != r + 1) throw std::invalid_argument("a block is given twice");
  }
  return map;
}

// Rows of a block and its 26 neighbours, -1 where there is none.
struct Around {
  int32_t row[27];
  Around(const BlockMap& map, const int32_t* c) {
    for (int i = 0; i < 27; ++i) row[i] = map.find(block_key(c[0] + i / 9 - 1, c[1] + i / 3 % 3 - 1, c[2] + i % 3 - 1));
  }
  // Local coordinates -1..8 to the row that holds the voxel.
  int32_t of(int x, int y, int z) const { return row[((x >> 3) + 1) * 9 + ((y >> 3) + 1) * 3 + (z >> 3) + 1]; }
};

// A block with one voxel of its neighbours on every side.
struct Halo {
  float v[kHalo][kHalo][kHalo];
  Halo(const Around& around, const float* value) {
    for (int x = -1; x <= kBlockSide; ++x)
      for (int y = -1; y <= kBlockSide; ++y)
        for (int z = -1; z <= kBlockSide; ++z) {
          const int32_t row = around.of(x, y, z);
          v[x + 1][y + 1][z + 1] = row < 0 ? NAN : value[int64_t{row} * kBlockVoxels + voxel_in_block(x, y, z)];
        }
  }
  float at(int x, int y, int z) const { return v[x + 1][y + 1][z + 1]; }
  // Which corners of the cube above a voxel are inside (negative); -1 if one is unknown.
  int cube(int x, int y, int z) const {
    int inside = 0;
    for (int c = 0; c < 8; ++c) {
      const float f = at(x + (c & 1), y + (c >> 1 & 1), z + (c >> 2));
      if (std::isnan(f)) return -1;
      inside |= (f < 0.f) << c;
    }
    return inside;
  }
};

// The vertices of a block: a bit per owned edge, numbered from `base` in the order of the bits.
struct EdgeSet {
  std::array<uint64_t, kWords> bits{};
  std::array<uint16_t, kWords> before{};
  int64_t base = 0;
  int count = 0;
  void close() {
    for (int w = 0; w < kWords; ++w) before[w] = static_cast<uint16_t>(count), count += __builtin_popcountll(bits[w]);
  }
  int32_t vertex(int edge) const {
    const uint64_t lower = bits[edge >> 6] & ((uint64_t{1} << (edge & 63)) - 1);
    return static_cast<int32_t>(base + before[edge >> 6] + __builtin_popcountll(lower));
  }
};

// Edges that a known cube crosses. The cubes that share an owned edge start at most one voxel below the block.
void mark_edges(const Halo& halo, EdgeSet* edges) {
  for (int x = -1; x < kBlockSide; ++x)
    for (int y = -1; y < kBlockSide; ++y)
      for (int z = -1; z < kBlockSide; ++z) {
        const int inside = halo.cube(x, y, z);
        if (inside <= 0 || inside == 255) continue;
        for (int e = 0; e < 12; ++e) {
          const int low = cube_edge_low(e), axis = cube_edge_axis(e);
          if ((inside >> low & 1) == (inside >> (low | 1 << axis) & 1)) continue;
          const int ex = x + (low & 1), ey = y + (low >> 1 & 1), ez = z + (low >> 2);
          if (((ex | ey | ez) & ~7) != 0) continue;  // another block's
          const int bit = voxel_in_block(ex, ey, ez) * 3 + axis;
          edges->bits[bit >> 6] |= uint64_t{1} << (bit & 63);
        }
      }
}

void place_vertices(const Halo& halo, const EdgeSet& edges, const int32_t* coords, double voxel_m, double* out) {
  for (int bit = 0; bit < kEdges; ++bit) {
    if (!(edges.bits[bit >> 6] >> (bit & 63) & 1)) continue;
    const int voxel = bit / 3, axis = bit % 3, x = voxel >> 6, y = voxel >> 3 & 7, z = voxel & 7;
    const float low = halo.at(x, y, z), high = halo.at(x + (axis == 0), y + (axis == 1), z + (axis == 2));
    const float share = std::min(1.f - kMinShare, std::max(kMinShare, low / (low - high)));
    const int local[3] = {x, y, z};
    for (int a = 0; a < 3; ++a)
      *out++ = (8.0 * coords[a] + local[a] + 0.5 + (a == axis ? static_cast<double>(share) : 0.0)) * voxel_m;
  }
}

}  // namespace

Surface marching_cubes(const int32_t* coords, const float* value, int64_t blocks, double voxel_m, int threads) {
  const BlockMap map = map_of(coords, blocks);
  std::vector<EdgeSet> edges(blocks);
  parallel_ranges(blocks, threads, [&](int64_t first, int64_t last) {
    for (int64_t r = first; r < last; ++r) {
      mark_edges(Halo(Around(map, coords + 3 * r), value), &edges[r]);
      edges[r].close();
    }
  });
  int64_t total = 0;
  for (EdgeSet& e : edges) e.base = total, total += e.count;
  if (total > INT32_MAX) throw std::invalid_argument("the surface has more than 2^31 vertices: use larger voxels");

  Surface surface;
  surface.vertices.resize(3 * total);
  const int64_t parts = std::max<int64_t>(1, std::min<int64_t>(threads, blocks));
  std::vector<std::vector<int32_t>> faces(parts);
  parallel_ranges(parts, threads, [&](int64_t p0, int64_t p1) {
    for (int64_t p = p0; p < p1; ++p)
      for (int64_t r = blocks * p / parts; r < blocks * (p + 1) / parts; ++r) {
        const Around around(map, coords + 3 * r);
        const Halo halo(around, value);
        place_vertices(halo, edges[r], coords + 3 * r, voxel_m, surface.vertices.data() + 3 * edges[r].base);
        for (int v = 0; v < kBlockVoxels; ++v) {
          const int x = v >> 6, y = v >> 3 & 7, z = v & 7, inside = halo.cube(x, y, z);
          if (inside <= 0 || inside == 255) continue;
          for (const int8_t e : cube_triangles(inside)) {
            const int low = cube_edge_low(e);
            const int ex = x + (low & 1), ey = y + (low >> 1 & 1), ez = z + (low >> 2);
            faces[p].push_back(edges[around.of(ex, ey, ez)].vertex(voxel_in_block(ex, ey, ez) * 3 + cube_edge_axis(e)));
          }
        }
      }
  });
  for (const auto& part : faces) surface.faces.insert(surface.faces.end(), part.begin(), part.end());
  return surface;
}

void fill_holes(const int32_t* coords, const float* value, int64_t blocks, float* filled, int threads) {
  const BlockMap map = map_of(coords, blocks);
  parallel_ranges(blocks, threads, [&](int64_t first, int64_t last) {
    for (int64_t r = first; r < last; ++r) {
      const Halo halo(Around(map, coords + 3 * r), value);
      for (int v = 0; v < kBlockVoxels; ++v) {
        const int x = v >> 6, y = v >> 3 & 7, z = v & 7;
        const float own = halo.at(x, y, z);
        filled[r * kBlockVoxels + v] = own;
        if (!std::isnan(own)) continue;
        float sum = 0.f;
        int known = 0;
        for (int i = 0; i < 27; ++i) {
          const float f = halo.at(x + i / 9 - 1, y + i / 3 % 3 - 1, z + i % 3 - 1);
          if (!std::isnan(f)) sum += f, ++known;
        }
        if (known > 13) filled[r * kBlockVoxels + v] = sum / static_cast<float>(known);
      }
    }
  });
}

}  // namespace coin3d
