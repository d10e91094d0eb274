// What the driver and the kernels of the splat renderer share.
#pragma once
#include <cstdint>

#include "splat.h"

namespace coin3d {

constexpr float kNear = 0.2f;
constexpr float kBlur = 0.3f;
constexpr float kMaxAlpha = 0.99f;
constexpr float kMinTransmittance = 1e-4f;
constexpr float kCutoff = 11.08253f;         // 2 ln 255: beyond this squared distance alpha is below 1/255
constexpr float kMinLog2Alpha = -7.994353f;  // -log2 255
constexpr int kMaxBlocks = 65535;            // block positions are 16-bit

// One Gaussian on the image. log2(alpha) / 8 = xx dx^2 + xy dx dy + yy dy^2 with (dx, dy) = pixel centre - (u, v).
struct SplatRecord {
  float u, v, xx, xy, yy;
  uint32_t rgb;
  uint16_t x0, x1, y0, y1;  // first and last block it touches
};

// The order of compositing is that of these numbers: depth bits above, slot of the record below.
using SplatKey = uint64_t;

// A camera in single precision with what the projection derives from it.
struct SplatView {
  float r[9], position[3], k[6], limits[4];
  float g00, g01, g11, det_g, trace_g;  // G = K2 K2^T
  float width, height;
  float planes[4][5];  // image sides: a chunk is visible if p0 x + p1 y + p2 z + p3 radius + p4 std >= 0
};

// One tile to composite: its keys front to back, where it is, and where the pixels go.
struct SplatTile {
  const SplatKey* keys;
  int64_t count;
  const SplatRecord* records;
  int64_t x0, y0;  // pixel
  int64_t width, height;  // of the image
  SplatImage image;
};

// One instruction set. A block is what one vector register holds: 4 pixels wide and lanes / 4 high. A tile has 64 blocks.
struct SplatKernel {
  const char* name;
  int block_height_log2;
  int tile_columns_log2, tile_rows_log2;  // in blocks
  // projects up to kSplatChunk rows; returns how many of them are on the image
  int64_t (*project)(const SplatScene& scene, int64_t first, int64_t count, const SplatView& view, SplatRecord* records,
                     uint32_t* depth_bits);
  void (*composite)(const SplatTile& tile);
};

extern const SplatKernel kSplatBaseline;
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define COIN3D_SPLAT_X86 1
extern const SplatKernel kSplatAvx2;
extern const SplatKernel kSplatAvx512;
#endif

}  // namespace coin3d
