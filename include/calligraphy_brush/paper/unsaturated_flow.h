#pragma once

namespace calligraphy_brush {

/// λ of the front λ √(D₀ t) of u_t = D₀ (u^q u_x)_x from u(0) = 1 into a dry half-space, q ≥ 1.
///
/// A similarity solution u(x / √t): found by integrating from the front inwards and scaling what comes
/// out to u(0) = 1. Error below 1e-6. Source: Philip, Adv. Hydroscience 5, 1969; J. R. King,
/// Q. J. Mech. Appl. Math. 42, 1989.
double frontFactor(int q);

/// Diffusivity D₀ of a full sheet [m²/s] such that its front runs as Washburn's √(2 D t).
double fullDiffusivity(double diffusivity, int q);

}  // namespace calligraphy_brush
