// The splat kernels for AVX-512. Headers come before the target, so that nothing shared is compiled for it.
#include "splat_types.h"

#ifdef COIN3D_SPLAT_X86
#include <immintrin.h>

#pragma GCC target("avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi,bmi2,prefer-vector-width=512")

namespace coin3d {
namespace splat_avx512 {
#define COIN3D_SPLAT_LANES 16
#include "splat_kernel.h"
}  // namespace splat_avx512

const SplatKernel kSplatAvx512 = {"avx512", splat_avx512::kBlockHeightLog2, splat_avx512::kColumnsLog2,
                                  splat_avx512::kRowsLog2, splat_avx512::project, splat_avx512::composite};
}  // namespace coin3d
#endif
