// The triangles of a marching cube, for each of the 256 ways its corners can be inside. Derived at start-up, see cube_cases.cpp.
#pragma once
#include <cstdint>
#include <vector>

namespace coin3d {

// Corner c of the cube lies at (c & 1, c >> 1 & 1, c >> 2). Edge e runs from its low corner one step along its axis.
constexpr int cube_edge_axis(int e) { return e >> 2; }
constexpr int cube_edge_low(int e) {
  const int axis = e >> 2, rest = e & 3;
  return axis == 0 ? rest << 1 : axis == 1 ? (rest & 1) | (rest & 2) << 1 : rest;
}

// Edges in threes, counter-clockwise seen from outside; bit c of `inside` says whether corner c is inside.
const std::vector<int8_t>& cube_triangles(int inside);

}  // namespace coin3d
