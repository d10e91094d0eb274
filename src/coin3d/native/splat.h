// Rendering of isotropic, opaque Gaussians through pinhole cameras: the definition is coin3d/rendering/reference.py.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace coin3d {

constexpr int64_t kSplatChunk = 256;  // rows that are culled together
constexpr int kSplatBounds = 5;       // of a chunk: sphere around the centres (x, y, z, radius), largest standard deviation

struct SplatScene {
  const float* centre;  // [n, 3]
  const float* std;     // [n]
  const uint8_t* rgb;   // [n, 3]
  const float* bounds;  // [ceil(n / kSplatChunk), kSplatBounds]
  int64_t n;
};

struct SplatCamera {
  double rotation[9];  // cam_from_ego, row by row
  double position[3];  // of the camera in the ego frame
  double K[6];         // first two rows
  double limits[4];    // slopes x / z (min, max) and y / z (min, max) at which the projection is linearised
  int64_t width, height;
};

struct SplatImage {
  uint8_t* rgb;  // [height, width, 3]
  float* depth;  // [height, width]
  float* alpha;  // [height, width]
};

void splat_bounds(const float* centre, const float* std, int64_t n, float* bounds);

// Instruction sets this machine can run, the fastest first; the last is "baseline".
std::vector<std::string> splat_instruction_sets();

// Any number of threads gives the same bits. An unknown or missing instruction set is a std::invalid_argument.
void splat_render(const SplatScene& scene, const std::vector<SplatCamera>& cameras, const std::vector<SplatImage>& images,
                  int threads, const std::string& instruction_set);

}  // namespace coin3d
