#include "calligraphy_brush/sim/rod_step.h"

#include <stdexcept>

namespace calligraphy_brush {

const RodStepKernel& findRodStepKernel(const std::string& name) {
  __builtin_cpu_init();
  const bool avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  const bool avx512 = avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                      __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512bw");
  if (avx512 && (name == "best" || name == "avx512")) return kRodStepAvx512;
  if (avx2 && (name == "best" || name == "avx2")) return kRodStepAvx2;
  if (name == "best" || name == "baseline") return kRodStepBaseline;
  throw std::invalid_argument("rods/instruction_set = " + name + ": this processor does not have it");
}

}  // namespace calligraphy_brush
