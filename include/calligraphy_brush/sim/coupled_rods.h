#pragma once

#include <array>

#include "calligraphy_brush/common/quads.h"
#include "calligraphy_brush/contact/bundle_contact.h"
#include "calligraphy_brush/rods/node_springs.h"
#include "calligraphy_brush/rods/rod_response.h"

namespace calligraphy_brush {

/// The rods of a batch as the others see them, and what conjugate gradients keep of them:
/// [edge][2][lane] unless said otherwise.
template <class Real>
struct CoupledBatch {
  /// First node of the rod in a lane, in the quads of BundleContact; lanes without a rod have the nodes
  /// of the rod there that is none.
  std::array<std::int32_t, kLanes> first_node{};
  AlignedVector<Real> present;    ///< 1 where a lane has a rod, else 0, [lane]
  AlignedVector<Real> shape;      ///< after the last solve, [edge][3][lane]
  AlignedVector<Real> springs;    ///< that the rods feel, see NodeSprings
  AlignedVector<Real> factor;     ///< of the rods' last sweeps, see RodResponse
  AlignedVector<Real> residual;   ///< loads that are not balanced yet [N]
  AlignedVector<Real> solution;   ///< the turns so far [m]
  AlignedVector<Real> direction;  ///< of the search [m]
  AlignedVector<Real> own;        ///< what the rods by themselves answer to it, M · direction [N]
  AlignedVector<Real> image;      ///< what all together answer to it [N]
  AlignedVector<Real> answer;     ///< M⁻¹ · residual [m]
  double energy = 0.0;
  double product = 0.0;  ///< what the last phase has to say of the batch
  double largest = 0.0;  ///< way of a node by `direction` [m]
};

/// The phases of preconditioned conjugate gradients for rods that are tied to one another.
///
/// Rods that are solved one by one, with their neighbours held where they are believed, come to agree
/// slowly in the motions that many of them make together. So the beliefs are improved by Newton's
/// method for all rods at once: (M + C) u = r, where r is what the rods' last steps leave unbalanced
/// now that the neighbours moved, M the rods by themselves, with the springs to where their neighbours
/// were believed (block diagonal, and factored by their last steps), and C the rest: what neighbours'
/// moves change, less those springs. M is the preconditioner. M · direction needs no product: it follows
/// from the recursion of the direction, as residual + β · (M · direction before).
/// Source: Shewchuk 1994, An Introduction to the Conjugate Gradient Method Without the Agonizing Pain,
/// section 12.
template <class V>
class CoupledRods {
 public:
  using Real = RealOf<V>;
  using Vector = Vec3<V>;
  using Response = RodResponse<V>;

  /// contact.gradient into the batch's springs.
  static void writeSprings(const BundleContact<Real>& contact, CoupledBatch<Real>& batch) {
    eachPart(batch, [&](int lane) {
      const std::int32_t* first = batch.first_node.data() + lane;
      for (int node = 0; node < contact.node_count; ++node) {
        const auto pull = Quads<V>::gatherAll(contact.gradient.data(), first, node);
        // Twice the curvature by this node alone: then the sum over all nodes lies above the energy.
        const V stiffness = pull.w + pull.w;
        const Vector way = Quads<V>::gather(contact.way.data(), first, node);
        Real* out = batch.springs.data() + node * kSpring + lane;
        (Vector{pull.x, pull.y, pull.z} - stiffness * way).storeTo(out);
        store<V>(out + 3 * kLanes, stiffness);
      }
    });
  }

  /// What the batch's rods did becomes what others believe of them, and the difference contact.move.
  /// `largest`: the largest of a node.
  static void believe(BundleContact<Real>& contact, const RodBatchState<Real>& state,
                      CoupledBatch<Real>& batch) {
    V largest{};
    eachPart(batch, [&](int lane) {
      const std::int32_t* first = batch.first_node.data() + lane;
      for (int node = 0; node < contact.node_count; ++node) {
        const Vector way = Vector::loadFrom(state.displacement.data() + node * kVector + lane);
        const Vector off = way - Quads<V>::gather(contact.way.data(), first, node);
        largest = max(largest, load<V>(batch.present.data() + lane) * squaredNorm(off));
        Quads<V>::scatter(off, contact.move.data(), first, node);
        Quads<V>::scatter(way, contact.way.data(), first, node);
        Quads<V>::scatter(Vector::loadFrom(state.position.data() + node * kVector + lane),
                          contact.point.data(), first, node);
      }
    });
    batch.largest = __builtin_sqrt(largestOf(largest));
  }

  /// Before the first iteration, after BundlePull::multiply of what believe() has left: the residual.
  static void begin(const BundleContact<Real>& contact, CoupledBatch<Real>& batch) {
    eachPart(batch, [&](int lane) {
      const std::int32_t* first = batch.first_node.data() + lane;
      Response::gather(
          contact.node_count - 1, factorOf(batch, lane),
          [&](int node) {
            return curvature(batch.springs.data() + node * kSpring + lane) *
                       Quads<V>::gather(contact.move.data(), first, node) -
                   Quads<V>::gather(contact.answer.data(), first, node);
          },
          [&](int edge, V load0, V load1) {
            Real* out = batch.residual.data() + edge * kTurn + lane;
            store<V>(out, load0);
            store<V>(out + kLanes, load1);
          });
    });
    for (auto* field : {&batch.solution, &batch.direction, &batch.own, &batch.image})
      __builtin_memset(field->data(), 0, field->size() * sizeof(Real));
  }

  /// A step of `length` along the direction, and what the rods by themselves answer to the residual that
  /// is left. `product`: of the two.
  static void advance(CoupledBatch<Real>& batch, double length) {
    const V step = broadcast<V>(static_cast<Real>(length));
    V product{};
    eachPart(batch, [&](int lane) {
      const int edges = edgesOf(batch);
      for (int i = 0; i < 2 * edges; ++i) {
        const int at = i * kLanes + lane;
        store<V>(&batch.solution[index(at)], in(batch.solution, at) + step * in(batch.direction, at));
        store<V>(&batch.residual[index(at)], in(batch.residual, at) - step * in(batch.image, at));
      }
      Response::solve(edges, factorOf(batch, lane), batch.residual.data() + lane,
                      batch.answer.data() + lane);
      for (int i = 0; i < 2 * edges; ++i) {
        const int at = i * kLanes + lane;
        product = product + in(batch.residual, at) * in(batch.answer, at);
      }
    });
    batch.product = sumOf(product);
  }

  /// The next direction, answer + turn · direction, and its way into contact.move.
  static void redirect(BundleContact<Real>& contact, CoupledBatch<Real>& batch, double turn) {
    const V part = broadcast<V>(static_cast<Real>(turn));
    V largest{};
    eachPart(batch, [&](int lane) {
      const int edges = edgesOf(batch);
      for (int i = 0; i < 2 * edges; ++i) {
        const int at = i * kLanes + lane;
        store<V>(&batch.direction[index(at)], in(batch.answer, at) + part * in(batch.direction, at));
        store<V>(&batch.own[index(at)], in(batch.residual, at) + part * in(batch.own, at));
      }
      Response::walk(edges, factorOf(batch, lane), batch.direction.data() + lane,
                     [&](int node, const Vector& way) {
                       largest = max(largest, squaredNorm(way));
                       Quads<V>::scatter(way, contact.move.data(), batch.first_node.data() + lane, node);
                     });
    });
    batch.largest = __builtin_sqrt(largestOf(largest));
  }

  /// What all together answer to the direction, after BundlePull::multiply. `product`: of the two.
  static void answer(const BundleContact<Real>& contact, CoupledBatch<Real>& batch) {
    V product{};
    eachPart(batch, [&](int lane) {
      const std::int32_t* first = batch.first_node.data() + lane;
      Response::gather(
          contact.node_count - 1, factorOf(batch, lane),
          [&](int node) {
            return Quads<V>::gather(contact.answer.data(), first, node) -
                   curvature(batch.springs.data() + node * kSpring + lane) *
                       Quads<V>::gather(contact.move.data(), first, node);
          },
          [&](int edge, V load0, V load1) {
            for (const int row : {0, 1}) {
              const int at = edge * kTurn + row * kLanes + lane;
              const V image = in(batch.own, at) + (row == 0 ? load0 : load1);
              store<V>(&batch.image[index(at)], image);
              product = product + image * in(batch.direction, at);
            }
          });
    });
    batch.product = sumOf(product);
  }

  /// The batch's shape after a part of the solution becomes what others believe, and what its next
  /// solve begins with. `state` is that of the beginning of the step.
  static void move(BundleContact<Real>& contact, const RodBatchModel<Real>& model,
                   const RodBatchRoots<Real>& roots, RodBatchState<Real>& state,
                   CoupledBatch<Real>& batch, double part) {
    state.guess.resize(state.edge.size());
    const V scale = broadcast<V>(static_cast<Real>(part));
    eachPart(batch, [&](int lane) {
      const std::int32_t* first = batch.first_node.data() + lane;
      const V length = load<V>(model.edge_length.data() + lane);
      Vector turned{}, way = Vector::loadFrom(roots.displacement.data() + lane),
                       point = Vector::loadFrom(roots.position.data() + lane);
      Response::walk(edgesOf(batch), factorOf(batch, lane), batch.solution.data() + lane,
                     [&](int node, const Vector& moved) {
                       const int at = (node - 1) * kVector + lane;
                       Vector e = Vector::loadFrom(batch.shape.data() + at) + scale * (moved - turned);
                       turned = moved;
                       e = (length / sqrt(squaredNorm(e))) * e;
                       e.storeTo(state.guess.data() + at);
                       way = way + (e - Vector::loadFrom(state.edge.data() + at));
                       point = point + e;
                       Quads<V>::scatter(way, contact.way.data(), first, node);
                       Quads<V>::scatter(point, contact.point.data(), first, node);
                     });
    });
  }

 private:
  static constexpr int kTurn = 2 * kLanes, kVector = 3 * kLanes,
                       kSpring = NodeSprings<V, NoPotential<Real>>::kRows * kLanes;

  template <class Part>
  static CALLIGRAPHY_INLINE void eachPart(const CoupledBatch<Real>&, Part&& part) {
    for (int lane = 0; lane < kLanes; lane += widthOf<V>) part(lane);
  }
  static const Real* factorOf(const CoupledBatch<Real>& batch, int lane) {
    return batch.factor.data() + lane * (edgesOf(batch) + 1) * kRodFactorRows;
  }
  static int edgesOf(const CoupledBatch<Real>& batch) {
    return static_cast<int>(batch.residual.size()) / kTurn;
  }
  static CALLIGRAPHY_INLINE std::size_t index(int at) { return static_cast<std::size_t>(at); }
  static CALLIGRAPHY_INLINE V in(const AlignedVector<Real>& field, int at) {
    return load<V>(field.data() + at);
  }
  static CALLIGRAPHY_INLINE V curvature(const Real* spring) { return load<V>(spring + 3 * kLanes); }
  static double sumOf(V values) {
    double sum = 0.0;
    for (int k = 0; k < widthOf<V>; ++k) sum += double(values[k]);
    return sum;
  }
  static double largestOf(V values) {
    double largest = 0.0;
    for (int k = 0; k < widthOf<V>; ++k)
      largest = largest < double(values[k]) ? double(values[k]) : largest;
    return largest;
  }
};

}  // namespace calligraphy_brush
