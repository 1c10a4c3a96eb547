#include "calligraphy_brush/sim/rod_step.h"

namespace calligraphy_brush {

const RodStepKernel kRodStepAvx512{
    "avx512", &rod_step_detail::solve<float, 64>, &rod_step_detail::solve<double, 64>,
    rod_step_detail::coupling<float, 64>(), rod_step_detail::coupling<double, 64>()};

}  // namespace calligraphy_brush
