// Projection and compositing, written once and compiled once per instruction set (splat_baseline.cpp, splat_avx2.cpp,
// splat_avx512.cpp). No include guard: every one of those files includes it exactly once, inside its own namespace.

#include "splat_simd.h"

constexpr int kBlockWidthLog2 = 2, kBlockWidth = 1 << kBlockWidthLog2;

constexpr int kBlockHeightLog2 = kLanes == 16 ? 2 : kLanes == 8 ? 1 : 0, kBlockHeight = 1 << kBlockHeightLog2;
constexpr int kColumnsLog2 = kLanes == 4 ? 2 : 3;  // tiles stay near square: 32x32, 32x16, 16x16 pixels
constexpr int kRowsLog2 = 6 - kColumnsLog2;
constexpr int kColumns = 1 << kColumnsLog2, kRows = 1 << kRowsLog2;

inline float clamped(float x, float low, float high) {
  x = x < low ? low : x;
  return x > high ? high : x;
}

// Everything the loop below knows of the rows of a chunk; separate arrays, so that the compiler can vectorise it.
struct Projected {
  alignas(64) float u[kSplatChunk], v[kSplatChunk], xx[kSplatChunk], xy[kSplatChunk], yy[kSplatChunk], z[kSplatChunk];
  alignas(64) int32_t x0[kSplatChunk], x1[kSplatChunk], y0[kSplatChunk], y1[kSplatChunk], visible[kSplatChunk];
};

static void project_rows(const float* __restrict centre, const float* __restrict std, int64_t count, const SplatView& view,
                         Projected& out) {
  const SplatView s = view;  // a copy: no store below can change it
  const float log2e = 1.44269504f;
  for (int64_t i = 0; i < count; ++i) {
    const float ex = centre[3 * i] - s.position[0], ey = centre[3 * i + 1] - s.position[1],
                ez = centre[3 * i + 2] - s.position[2];
    const float x = s.r[0] * ex + s.r[1] * ey + s.r[2] * ez;
    const float y = s.r[3] * ex + s.r[4] * ey + s.r[5] * ez;
    const float z = s.r[6] * ex + s.r[7] * ey + s.r[8] * ez;
    const float inverse = 1.f / (z > kNear ? z : kNear);
    const float px = x * inverse, py = y * inverse;
    const float u = s.k[0] * px + s.k[1] * py + s.k[2], v = s.k[3] * px + s.k[4] * py + s.k[5];
    // covariance = ratio^2 (G + k k^T) + blur, k = K2 (slope_x, slope_y); its determinant without cancellation
    const float slope_x = clamped(px, s.limits[0], s.limits[1]), slope_y = clamped(py, s.limits[2], s.limits[3]);
    const float kx = s.k[0] * slope_x + s.k[1] * slope_y, ky = s.k[3] * slope_x + s.k[4] * slope_y;
    const float ratio = clamped(std[i] * inverse, 0.f, 1e4f), ratio2 = ratio * ratio;
    const float cxx = ratio2 * (s.g00 + kx * kx) + kBlur, cxy = ratio2 * (s.g01 + kx * ky),
                cyy = ratio2 * (s.g11 + ky * ky) + kBlur;
    const float det = ratio2 * ratio2 * s.det_g * (1.f + slope_x * slope_x + slope_y * slope_y) +
                      kBlur * ratio2 * (s.trace_g + kx * kx + ky * ky) + kBlur * kBlur;
    const float scale = -0.5f / 8.f * log2e / det;
    // half the bounding box, grown by more than the rounding of u and v
    const float reach_x = __builtin_sqrtf(kCutoff * cxx) + 0.01f, reach_y = __builtin_sqrtf(kCutoff * cyy) + 0.01f;
    const float left = u - reach_x, right = u + reach_x, top = v - reach_y, bottom = v + reach_y;
    out.u[i] = u;
    out.v[i] = v;
    out.xx[i] = scale * cyy;
    out.xy[i] = -2.f * scale * cxy;
    out.yy[i] = scale * cxx;
    out.z[i] = z;
    out.visible[i] = (z > kNear) & (right > 0.5f) & (left < s.width - 0.5f) & (bottom > 0.5f) & (top < s.height - 0.5f);
    // pixels whose centre lies inside: ceil(left - 0.5) to floor(right - 0.5)
    out.x0[i] = static_cast<int32_t>(clamped(left + 0.5f, 0.f, s.width - 1.f)) >> kBlockWidthLog2;
    out.x1[i] = static_cast<int32_t>(clamped(right - 0.5f, 0.f, s.width - 1.f)) >> kBlockWidthLog2;
    out.y0[i] = static_cast<int32_t>(clamped(top + 0.5f, 0.f, s.height - 1.f)) >> kBlockHeightLog2;
    out.y1[i] = static_cast<int32_t>(clamped(bottom - 0.5f, 0.f, s.height - 1.f)) >> kBlockHeightLog2;
  }
}

static int64_t project(const SplatScene& scene, int64_t first, int64_t count, const SplatView& view, SplatRecord* records,
                       uint32_t* depth_bits) {
  Projected p;
  project_rows(scene.centre + 3 * first, scene.std + first, count, view, p);
  const uint8_t* rgb = scene.rgb + 3 * first;
  int64_t n = 0;
  for (int64_t i = 0; i < count; ++i) {  // no branch: what is not visible is overwritten by the next
    SplatRecord& r = records[n];
    r.u = p.u[i];
    r.v = p.v[i];
    r.xx = p.xx[i];
    r.xy = p.xy[i];
    r.yy = p.yy[i];
    r.rgb = static_cast<uint32_t>(rgb[3 * i]) | static_cast<uint32_t>(rgb[3 * i + 1]) << 8 |
            static_cast<uint32_t>(rgb[3 * i + 2]) << 16;
    r.x0 = static_cast<uint16_t>(p.x0[i]);
    r.x1 = static_cast<uint16_t>(p.x1[i]);
    r.y0 = static_cast<uint16_t>(p.y0[i]);
    r.y1 = static_cast<uint16_t>(p.y1[i]);
    __builtin_memcpy(&depth_bits[n], &p.z[i], 4);
    n += p.visible[i];
  }
  return n;
}

// The pixels of one block. A pixel is finished when the sign bit of its transmittance is set; its size stays.
struct Block {
  Vec transmittance, red, green, blue, depth;
};

static void open_pixels(const SplatTile& tile, Block* blocks, uint64_t& live) {
  live = 0;
  for (int b = 0; b < kColumns * kRows; ++b) {
    blocks[b] = Block{};
    const int64_t x0 = tile.x0 + (b % kColumns) * kBlockWidth, y0 = tile.y0 + (b / kColumns) * kBlockHeight;
    for (int l = 0; l < kLanes; ++l) {
      const bool inside = x0 + l % kBlockWidth < tile.width && y0 + l / kBlockWidth < tile.height;
      blocks[b].transmittance[l] = inside ? 1.f : -1.f;
    }
    if (x0 < tile.width && y0 < tile.height) live |= uint64_t{1} << b;
  }
}

static void write_pixels(const SplatTile& tile, const Block* blocks) {
  const SplatImage image = tile.image;
  const int64_t image_width = tile.width, image_height = tile.height;
  for (int b = 0; b < kColumns * kRows; ++b) {
    const int64_t x0 = tile.x0 + (b % kColumns) * kBlockWidth, y0 = tile.y0 + (b / kColumns) * kBlockHeight;
    if (x0 >= image_width) continue;
    const int columns = static_cast<int>(image_width - x0 < kBlockWidth ? image_width - x0 : kBlockWidth);
    const Block& block = blocks[b];
    const Vec half = broadcast(0.5f);
    const IntVec red = __builtin_convertvector(block.red + half, IntVec),
                 green = __builtin_convertvector(block.green + half, IntVec),
                 blue = __builtin_convertvector(block.blue + half, IntVec);
    const IntVec packed = red | (green << 8) | (blue << 16);
    const Vec alpha = 1.f - (Vec)((IntVec)block.transmittance & INT32_MAX);
    alignas(64) uint8_t colours[4 * kLanes];
    alignas(64) float depths[kLanes], alphas[kLanes];
    __builtin_memcpy(colours, &packed, sizeof colours);
    __builtin_memcpy(depths, &block.depth, sizeof depths);
    __builtin_memcpy(alphas, &alpha, sizeof alphas);
    for (int row = 0; row < kBlockHeight && y0 + row < image_height; ++row) {
      const int64_t pixel = (y0 + row) * image_width + x0;
      const int lane = row * kBlockWidth;
      for (int x = 0; x < columns; ++x) {
        __builtin_memcpy(image.rgb + 3 * (pixel + x), colours + 4 * (lane + x), 3);
        image.depth[pixel + x] = depths[lane + x];
        image.alpha[pixel + x] = alphas[lane + x];
      }
    }
  }
}

// The blocks of a tile that a splat touches, as bits; (x0, y0) is the tile's first block.
inline uint64_t touched(const SplatRecord& r, int x0, int y0) {
  const int left = r.x0 > x0 ? r.x0 - x0 : 0, right = r.x1 < x0 + kColumns ? r.x1 - x0 : kColumns - 1;
  const int top = r.y0 > y0 ? r.y0 - y0 : 0, bottom = r.y1 < y0 + kRows ? r.y1 - y0 : kRows - 1;
  const uint64_t row = (uint64_t{2} << right) - (uint64_t{1} << left);
  const uint64_t every_row = ~uint64_t{0} / ((uint64_t{1} << kColumns) - 1);
  const uint64_t rows = (~uint64_t{0} << (kColumns * top)) & (~uint64_t{0} >> (kColumns * (kRows - 1 - bottom)));
  return (row * every_row) & rows;
}

static void composite(const SplatTile& tile) {
  Block blocks[kColumns * kRows];
  uint64_t live;
  open_pixels(tile, blocks, live);
  const int block_x0 = static_cast<int>(tile.x0 / kBlockWidth), block_y0 = static_cast<int>(tile.y0 / kBlockHeight);
  Vec lane_x, lane_y;  // centre of the lane's pixel in the tile's first block
  for (int l = 0; l < kLanes; ++l) {
    lane_x[l] = static_cast<float>(tile.x0 + l % kBlockWidth) + 0.5f;
    lane_y[l] = static_cast<float>(tile.y0 + l / kBlockWidth) + 0.5f;
  }
  float step_x[kColumns], step_y[kRows];
  for (int i = 0; i < kColumns; ++i) step_x[i] = static_cast<float>(i * kBlockWidth);
  for (int i = 0; i < kRows; ++i) step_y[i] = static_cast<float>(i * kBlockHeight);
  const Vec max_alpha = broadcast(kMaxAlpha), lowest = broadcast(kMinLog2Alpha / 8.f), stop = broadcast(kMinTransmittance);
  const IntVec sign = IntVec{} + INT32_MIN;

  for (int64_t i = 0; i < tile.count && live; ++i) {
    if (i + 8 < tile.count) __builtin_prefetch(&tile.records[static_cast<uint32_t>(tile.keys[i + 8])]);
    const SplatRecord& r = tile.records[static_cast<uint32_t>(tile.keys[i])];
    uint64_t mask = touched(r, block_x0, block_y0) & live;
    if (!mask) continue;
    const uint32_t z_bits = static_cast<uint32_t>(tile.keys[i] >> 32);
    float z;
    __builtin_memcpy(&z, &z_bits, 4);
    const Vec red = broadcast(static_cast<float>(r.rgb & 255)), green = broadcast(static_cast<float>(r.rgb >> 8 & 255)),
              blue = broadcast(static_cast<float>(r.rgb >> 16)), depth = broadcast(z);
    const Vec xx = broadcast(r.xx), xy = broadcast(r.xy), yy = broadcast(r.yy);
    const Vec first_dx = lane_x - r.u, first_dy = lane_y - r.v;
    do {
      const int b = __builtin_ctzll(mask);
      mask &= mask - 1;
      Block& block = blocks[b];
      const Vec dx = first_dx + step_x[b % kColumns], dy = first_dy + step_y[b / kColumns];
      const Vec exponent = (xx * dx + xy * dy) * dx + (yy * dy) * dy;
      const Vec alpha = keep(not_less(exponent, lowest), smaller(exp2_eightfold(exponent), max_alpha));
      const Vec before = block.transmittance, after = minus_product(before, alpha, before);
      const Mask finished = less(after, stop);  // holds for pixels that were finished before: their sign is set
      const Vec weight = product_unless(finished, alpha, before);
      block.transmittance = choose(finished, (Vec)((IntVec)before | sign), after);
      block.red += weight * red;
      block.green += weight * green;
      block.blue += weight * blue;
      block.depth += weight * depth;
      if (all(finished)) live &= ~(uint64_t{1} << b);
    } while (mask);
  }
  write_pixels(tile, blocks);
}
