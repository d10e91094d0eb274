// Python bindings of what scene construction uses.
#pragma once
#include <nanobind/nanobind.h>

namespace coin3d {

void bind_scenes(nanobind::module_& m);

}  // namespace coin3d
