// The zero surface of a field given on sparse blocks.
#pragma once
#include <cstdint>
#include <vector>

namespace coin3d {

struct Surface {
  std::vector<double> vertices;  // x, y, z in metres
  std::vector<int32_t> faces;    // three vertices each, counter-clockwise seen from where the field is positive
};

// coords: (blocks, 3) block coordinates, each once. value: (blocks, 8, 8, 8), the field at voxel centres, voxel (0, 0, 0) of block
// (i, j, k) centred at (8 i + 0.5, ...) voxels; NaN where nothing is known. A cube between eight voxel centres gives triangles if
// all eight are known. Vertices lie on lattice edges and are shared, across blocks too. The result does not depend on `threads`.
// Throws std::invalid_argument for repeated or far blocks.
Surface marching_cubes(const int32_t* coords, const float* value, int64_t blocks, double voxel_m, int threads);

// One pass over unknown voxels: those with more than half of their 26 neighbours known take their mean. Closes pinholes and notches
// of a voxel without growing a straight rim. `filled` has the shape of `value`.
void fill_holes(const int32_t* coords, const float* value, int64_t blocks, float* filled, int threads);

}  // namespace coin3d
