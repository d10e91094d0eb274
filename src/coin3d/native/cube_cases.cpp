#include "cube_cases.h"

#include <array>

namespace coin3d {
namespace {

// How it is derived. Walk around a face of the cube, counter-clockwise seen from outside the cube. Every run of inside corners is
// cut off by one line, from the edge where the walk leaves the run to the edge where it entered: on a face with two opposite inside
// corners they stay apart. The rule looks at the corners of the face alone, so two cubes agree on the face they share and the
// surface closes. An edge that is crossed is left on one of its two faces and entered on the other; so the lines chain up to loops.
// A loop is cut into triangles such that as few cuts as possible lie in a face of the cube: none, in every case, which keeps
// three or more triangles from meeting in one cut.

int edge_between(int a, int b) {
  for (int e = 0; e < 12; ++e) {
    const int low = cube_edge_low(e), high = low | 1 << cube_edge_axis(e);
    if ((low == a && high == b) || (low == b && high == a)) return e;
  }
  return -1;
}

// The two faces an edge lies in, as bits 2 * axis + side.
int faces_of(int e) {
  int faces = 0;
  for (int axis = 0; axis < 3; ++axis)
    if (axis != cube_edge_axis(e)) faces |= 1 << (2 * axis + (cube_edge_low(e) >> axis & 1));
  return faces;
}

std::array<int, 12> next_edges(int inside) {
  std::array<int, 12> next;
  next.fill(-1);
  for (int axis = 0; axis < 3; ++axis)
    for (int side = 0; side < 2; ++side) {
      const int u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3, base = side << axis;
      std::array<int, 4> ring = {base, base | u, base | u | v, base | v};
      if (side == 0) ring = {base, base | v, base | u | v, base | u};
      for (int i = 0; i < 4; ++i) {
        if (!(inside >> ring[i] & 1) || (inside >> ring[(i + 1) % 4] & 1)) continue;
        int j = i;
        while (inside >> ring[(j + 3) % 4] & 1) j = (j + 3) % 4;
        next[edge_between(ring[i], ring[(i + 1) % 4])] = edge_between(ring[(j + 3) % 4], ring[j]);
      }
    }
  return next;
}

void cut_loop(const std::vector<int>& loop, std::vector<int8_t>* triangles) {
  const int n = static_cast<int>(loop.size());
  // cost[i][k]: fewest cuts in faces to cut up the polygon i, i + 1, ..., k; a bound of 12 vertices makes it cheap
  std::array<std::array<int, 12>, 12> cost{}, best{};
  const auto cut = [&](int i, int k) {
    const bool side = k == i + 1 || (i == 0 && k == n - 1);
    return !side && (faces_of(loop[i]) & faces_of(loop[k])) ? 1 : 0;
  };
  for (int span = 2; span < n; ++span)
    for (int i = 0; i + span < n; ++i) {
      cost[i][i + span] = 1 << 20;
      for (int j = i + 1; j < i + span; ++j) {
        const int c = cost[i][j] + cost[j][i + span] + cut(i, j) + cut(j, i + span);
        if (c < cost[i][i + span]) cost[i][i + span] = c, best[i][i + span] = j;
      }
    }
  std::vector<std::array<int, 2>> todo = {{0, n - 1}};
  while (!todo.empty()) {
    const auto [i, k] = todo.back();
    todo.pop_back();
    if (k - i < 2) continue;
    const int j = best[i][k];
    for (const int corner : {i, k, j}) triangles->push_back(static_cast<int8_t>(loop[corner]));
    todo.push_back({i, j});
    todo.push_back({j, k});
  }
}

std::array<std::vector<int8_t>, 256> derive() {
  std::array<std::vector<int8_t>, 256> cases;
  for (int inside = 0; inside < 256; ++inside) {
    std::array<int, 12> next = next_edges(inside);
    for (int e = 0; e < 12; ++e) {
      std::vector<int> loop;
      for (int at = e; next[at] >= 0;) {
        loop.push_back(at);
        const int then = next[at];
        next[at] = -1;
        at = then;
      }
      if (!loop.empty()) cut_loop(loop, &cases[inside]);
    }
  }
  return cases;
}

}  // namespace

const std::vector<int8_t>& cube_triangles(int inside) {
  static const std::array<std::vector<int8_t>, 256> cases = derive();
  return cases[inside];
}

}  // namespace coin3d
