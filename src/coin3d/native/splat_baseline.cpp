// The splat kernels for any processor: SSE2 on x86-64, NEON on ARM.
#include "splat_types.h"

namespace coin3d {
namespace splat_baseline {
#define COIN3D_SPLAT_LANES 4
#include "splat_kernel.h"
}  // namespace splat_baseline

const SplatKernel kSplatBaseline = {"baseline", splat_baseline::kBlockHeightLog2, splat_baseline::kColumnsLog2,
                                    splat_baseline::kRowsLog2, splat_baseline::project, splat_baseline::composite};
}  // namespace coin3d
