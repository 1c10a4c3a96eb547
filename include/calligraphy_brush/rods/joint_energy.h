#pragma once

#include "calligraphy_brush/common/lanes.h"

namespace calligraphy_brush {

/// Quaternion w + x i + y j + z k a lane. A unit one turns the material frame of an edge into the
/// paper frame: its third axis is the tangent, the first two are the directors.
template <class V>
struct Quaternion {
  V w, x, y, z;

  static CALLIGRAPHY_INLINE Quaternion loadFrom(const RealOf<V>* address) {
    return {load<V>(address), load<V>(address + kLanes), load<V>(address + 2 * kLanes),
            load<V>(address + 3 * kLanes)};
  }
  CALLIGRAPHY_INLINE void storeTo(RealOf<V>* address) const {
    store<V>(address, w);
    store<V>(address + kLanes, x);
    store<V>(address + 2 * kLanes, y);
    store<V>(address + 3 * kLanes, z);
  }
  friend CALLIGRAPHY_INLINE Quaternion operator*(const Quaternion& a, const Quaternion& b) {
    return {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
            a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
  }
  CALLIGRAPHY_INLINE Quaternion conjugate() const { return {w, -x, -y, -z}; }
};

template <class V>
CALLIGRAPHY_INLINE V dot(const Quaternion<V>& a, const Quaternion<V>& b) {
  return a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class Mask, class V>
CALLIGRAPHY_INLINE Quaternion<V> select(Mask mask, const Quaternion<V>& a, const Quaternion<V>& b) {
  return {select(mask, a.w, b.w), select(mask, a.x, b.x), select(mask, a.y, b.y),
          select(mask, a.z, b.z)};
}

/// Axes of the frame: the columns of its rotation matrix.
template <class V>
CALLIGRAPHY_INLINE void axes(const Quaternion<V>& q, Vec3<V>& d1, Vec3<V>& d2, Vec3<V>& tangent) {
  const V one = broadcast<V>(1), two = broadcast<V>(2);
  d1 = {one - two * (q.y * q.y + q.z * q.z), two * (q.x * q.y + q.w * q.z),
        two * (q.x * q.z - q.w * q.y)};
  d2 = {two * (q.x * q.y - q.w * q.z), one - two * (q.x * q.x + q.z * q.z),
        two * (q.y * q.z + q.w * q.x)};
  tangent = {two * (q.x * q.z + q.w * q.y), two * (q.y * q.z - q.w * q.x),
             one - two * (q.x * q.x + q.y * q.y)};
}

/// Arc tangent of y/x for x ≥ 0, to a few roundings of double.
/// Source: Moshier, Methods and Programs for Mathematical Functions (1989), the Cephes atan.
template <class V>
CALLIGRAPHY_INLINE V arcTangent(V y, V x) {
  const auto c = [](double value) { return broadcast<V>(static_cast<RealOf<V>>(value)); };
  const V zero{}, one = c(1);
  const V size = select(y < zero, -y, y);
  // Into [0, tan(π/8)] or so: atan(size/x) = offset + atan(p/q).
  const auto steep = size > c(2.414213562373095) * x;
  const auto middle = size > c(0.66) * x;
  const V p = select(steep, -x, select(middle, size - x, size));
  const V q = select(steep, size, select(middle, size + x, x));
  const V offset = select(steep, c(1.5707963267948966), select(middle, c(0.78539816339744831), zero));
  const V t = p / select(q > zero, q, one);
  const V z = t * t;
  const V numerator = (((c(-8.750608600031904122785e-1) * z + c(-1.615753718733365076637e1)) * z +
                        c(-7.500855792314704667340e1)) *
                           z +
                       c(-1.228866684490136173410e2)) *
                          z +
                      c(-6.485021904942025371773e1);
  const V denominator = ((((z + c(2.485846490142306297962e1)) * z + c(1.650270098316988542046e2)) * z +
                          c(4.328810604912902668951e2)) *
                             z +
                         c(4.853903996359136964868e2)) *
                            z +
                        c(1.945506571482613964425e2);
  const V angle = offset + (t + t * z * (numerator / denominator));
  return select(y < zero, -angle, angle);
}

/// Stiffness of a joint between two edges and the strain that it has at rest.
template <class V>
struct Joint {
  V bend1, bend2, twist;                ///< EI₁/l̄, EI₂/l̄, GJ/l̄ [N m]
  V natural1, natural2, natural_twist;  ///< κ̄₁, κ̄₂, m̄: integrated over the joint's length l̄ [1]
};

/// Strain of a joint whose edges' frames are related by q = q₀* q₁, q.w ≥ 0:
///
///   κ = 2 (x, y)/r,  r² = w² + z² + b (x² + y²)   bending, in the directors half-way between the two
///                                                  edges'; b = 1 − 4 p with p of bendingTerms:
///                                                  0 for |κ| = 2 tan(φ/2), 1 for 2 sin(φ/2)
///   m = 2 atan(z/w)                                the angle by which the directors twist
///
/// Neither depends on the length of q. `round` is b.
/// Source: Bergou et al. 2008, Discrete Elastic Rods, equation 1, for b = 0.
template <class V>
struct JointStrain {
  V bend1, bend2, twist;
};

namespace joint_detail {
template <class V>
CALLIGRAPHY_INLINE V inverseRadius(const Quaternion<V>& q, V round) {
  const V squared = q.w * q.w + q.z * q.z + round * (q.x * q.x + q.y * q.y);
  return broadcast<V>(1) / sqrt(max(squared, broadcast<V>(RealOf<V>(1e-12))));
}
}  // namespace joint_detail

template <class V>
CALLIGRAPHY_INLINE JointStrain<V> jointStrain(const Quaternion<V>& q, V round) {
  const V two = broadcast<V>(2), i = joint_detail::inverseRadius(q, round);
  return {two * i * q.x, two * i * q.y, two * arcTangent(q.z, q.w)};
}

/// E = ½ bend₁ (κ₁ − κ̄₁)² + ½ bend₂ (κ₂ − κ̄₂)² + ½ twist (m − m̄)² [J].
/// Source: Bergou et al. 2008, Discrete Elastic Rods, section 4.2, in principal directors.
template <class V>
CALLIGRAPHY_INLINE V jointEnergy(const Quaternion<V>& q, const Joint<V>& joint, V round) {
  const JointStrain<V> strain = jointStrain(q, round);
  const V a = strain.bend1 - joint.natural1, b = strain.bend2 - joint.natural2,
          c = strain.twist - joint.natural_twist;
  return broadcast<V>(RealOf<V>(0.5)) *
         (joint.bend1 * a * a + joint.bend2 * b * b + joint.twist * c * c);
}

/// Derivatives of the energy by small turns of the two frames, q₀ → q₀ exp(ω₀/2), q₁ → q₁ exp(ω₁/2),
/// ω in the frame's own axes [rad]. Blocks are [row of ω][column of ω].
template <class V>
struct JointDerivatives {
  V gradient0[3], gradient1[3];
  V hessian00[3][3], hessian01[3][3], hessian11[3][3];
};

/// With H the second derivative of E by q and e the unit quaternions i, j, k:
///
///   ∂E/∂ω₁ₖ = ½ ∇E·(q eₖ)          ∂²E/∂ω₁ⱼ∂ω₁ₖ = ¼ (q eⱼ)ᵀH(q eₖ)
///   ∂E/∂ω₀ₖ = −½ ∇E·(eₖ q)         ∂²E/∂ω₀ⱼ∂ω₁ₖ = −¼ (eⱼ q)ᵀH(q eₖ) − ¼ ∇E·(eⱼ q eₖ)
///
/// E has degree 0 in q, so ∇E·q = 0 and the second derivatives of exp itself drop out. With
/// D = diag(1, b, b, 1), r² = qᵀDq and d = Dq,
///
///   ∇κ₁ = 2 e_x/r − 2 x d/r³,   ∇²κ₁ = −2 (e_x dᵀ + d e_xᵀ)/r³ − 2 x D/r³ + 6 x d dᵀ/r⁵
///
/// `convex` in [0, 1] leaves out that part of what is not JᵀKJ, with J the derivative of the strain.
template <class V>
CALLIGRAPHY_INLINE void jointDerivatives(const Quaternion<V>& q, const Joint<V>& joint, V round,
                                         V convex, JointDerivatives<V>& out) {
  const V zero{}, two = broadcast<V>(2), quarter = broadcast<V>(RealOf<V>(0.25)),
                  half = broadcast<V>(RealOf<V>(0.5)), four = broadcast<V>(4), six = broadcast<V>(6);
  const V i1 = joint_detail::inverseRadius(q, round), i2 = i1 * i1, i3 = i1 * i2, i5 = i3 * i2;
  const V spin = broadcast<V>(1) / max(q.w * q.w + q.z * q.z, broadcast<V>(RealOf<V>(1e-12)));
  const JointStrain<V> strain{two * i1 * q.x, two * i1 * q.y, two * arcTangent(q.z, q.w)};
  const V f1 = joint.bend1 * (strain.bend1 - joint.natural1);
  const V f2 = joint.bend2 * (strain.bend2 - joint.natural2);
  const V f3 = joint.twist * (strain.twist - joint.natural_twist);

  // Gradients of the strains by (w, x, y, z).
  const Quaternion<V> d{q.w, round * q.x, round * q.y, q.z};
  const auto bendGradient = [&](V component, V in_x, V in_y) {
    const V c = -two * component * i3;
    return Quaternion<V>{c * d.w, in_x + c * d.x, in_y + c * d.y, c * d.z};
  };
  const Quaternion<V> k1 = bendGradient(q.x, two * i1, zero), k2 = bendGradient(q.y, zero, two * i1);
  const Quaternion<V> k3{-two * q.z * spin, zero, zero, two * q.w * spin};
  const Quaternion<V> gradient{f1 * k1.w + f2 * k2.w + f3 * k3.w, f1 * k1.x + f2 * k2.x,
                               f1 * k1.y + f2 * k2.y, f1 * k1.z + f2 * k2.z + f3 * k3.z};

  // The part of H that bends with the forces.
  const V part = broadcast<V>(1) - convex;
  const V along = f1 * q.x + f2 * q.y;
  const V turn = part * f3 * spin * spin;
  const V Tww = turn * four * q.z * q.w, Twz = turn * two * (q.z * q.z - q.w * q.w);
  const auto apply = [&](const Quaternion<V>& v) {
    const V s1 = joint.bend1 * dot(k1, v), s2 = joint.bend2 * dot(k2, v), s3 = joint.twist * dot(k3, v);
    const V d_v = dot(d, v), f_v = f1 * v.x + f2 * v.y;
    const V on_d = part * (six * i5 * along * d_v - two * i3 * f_v);
    const V on_f = -part * two * i3 * d_v, on_D = -part * two * i3 * along;
    return Quaternion<V>{
        s1 * k1.w + s2 * k2.w + s3 * k3.w + on_d * d.w + on_D * v.w + Tww * v.w + Twz * v.z,
        s1 * k1.x + s2 * k2.x + on_d * d.x + on_D * round * v.x + on_f * f1,
        s1 * k1.y + s2 * k2.y + on_d * d.y + on_D * round * v.y + on_f * f2,
        s1 * k1.z + s2 * k2.z + s3 * k3.z + on_d * d.z + on_D * v.z + Twz * v.w - Tww * v.z};
  };

  const Quaternion<V> right[3] = {
      {-q.x, q.w, q.z, -q.y}, {-q.y, -q.z, q.w, q.x}, {-q.z, q.y, -q.x, q.w}};
  const Quaternion<V> left[3] = {{-q.x, q.w, -q.z, q.y}, {-q.y, q.z, q.w, -q.x}, {-q.z, -q.y, q.x, q.w}};
  for (int k = 0; k < 3; ++k) {
    out.gradient1[k] = half * dot(gradient, right[k]);
    out.gradient0[k] = -half * dot(gradient, left[k]);
    const Quaternion<V> H_right = apply(right[k]), H_left = apply(left[k]);
    for (int j = 0; j < 3; ++j) {
      out.hessian11[j][k] = quarter * dot(right[j], H_right);
      out.hessian00[j][k] = quarter * dot(left[j], H_left);
      out.hessian01[j][k] = -quarter * dot(left[j], H_right);
    }
  }
  // ∇E·(eⱼ q eₖ), with eⱼ q eₖ = left[j] eₖ.
  const V scale = -quarter * part;
  for (int j = 0; j < 3; ++j) {
    const Quaternion<V>& l = left[j];
    out.hessian01[j][0] =
        out.hessian01[j][0] + scale * dot(gradient, Quaternion<V>{-l.x, l.w, l.z, -l.y});
    out.hessian01[j][1] =
        out.hessian01[j][1] + scale * dot(gradient, Quaternion<V>{-l.y, -l.z, l.w, l.x});
    out.hessian01[j][2] =
        out.hessian01[j][2] + scale * dot(gradient, Quaternion<V>{-l.z, l.y, -l.x, l.w});
  }
}

}  // namespace calligraphy_brush
