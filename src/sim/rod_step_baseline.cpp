#include "calligraphy_brush/sim/rod_step.h"

namespace calligraphy_brush {

const RodStepKernel kRodStepBaseline{
    "baseline", &rod_step_detail::solve<float, 16>, &rod_step_detail::solve<double, 16>,
    rod_step_detail::coupling<float, 16>(), rod_step_detail::coupling<double, 16>()};

}  // namespace calligraphy_brush
