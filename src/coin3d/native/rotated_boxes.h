// Overlap of rotated rectangles seen from above, and non-maximum suppression with it.
#pragma once
#include <cstdint>
#include <vector>

namespace coin3d {

// A rectangle is five doubles: x, y, length, width, yaw (radians, counter-clockwise).
double rotated_iou(const double* a, const double* b);

// Indices kept, best score first; `order` lists the boxes by falling score. A box is dropped when its IoU with a kept one
// is at least `iou_threshold`.
std::vector<int64_t> rotated_nms(const double* boxes, const int64_t* order, int64_t n, double iou_threshold);

}  // namespace coin3d
