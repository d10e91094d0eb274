// The splat kernels for AVX2. Headers come before the target, so that nothing shared is compiled for it.
#include "splat_types.h"

#ifdef COIN3D_SPLAT_X86
#include <immintrin.h>

#pragma GCC target("avx2,fma,bmi,bmi2")

namespace coin3d {
namespace splat_avx2 {
#define COIN3D_SPLAT_LANES 8
#include "splat_kernel.h"
}  // namespace splat_avx2

const SplatKernel kSplatAvx2 = {"avx2", splat_avx2::kBlockHeightLog2, splat_avx2::kColumnsLog2,
                                  splat_avx2::kRowsLog2, splat_avx2::project, splat_avx2::composite};
}  // namespace coin3d
#endif
