// What evaluation needs of this folder.
#pragma once
#include <nanobind/nanobind.h>

namespace coin3d {
void bind_evaluation(nanobind::module_& m);
}
