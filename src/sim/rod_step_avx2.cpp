#include "calligraphy_brush/sim/rod_step.h"

namespace calligraphy_brush {

const RodStepKernel kRodStepAvx2{
    "avx2", &rod_step_detail::solve<float, 32>, &rod_step_detail::solve<double, 32>,
    rod_step_detail::coupling<float, 32>(), rod_step_detail::coupling<double, 32>()};

}  // namespace calligraphy_brush
