// Time of Pinocchio's forward dynamics of one tree, with balls and rods that close loops or without, at the
// states of a file, and its largest difference to the accelerations there. Arguments: model, states; run.py
// says what they hold.

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/constrained-dynamics.hpp>
#include <pinocchio/algorithm/contact-dynamics.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea.hpp>

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <functional>
#include <iostream>
#include <string>
#include <vector>

namespace pin = pinocchio;
using Eigen::Vector3d;
using Eigen::VectorXd;
// What the library is instantiated with.
using Given = Eigen::Ref<const VectorXd>;

constexpr int ROUNDS = 9;
constexpr double ROUND_SECONDS = 0.02;

struct Body {
    std::string type;
    Vector3d center; // in the axes of its joint
};

/// A point of each of two bodies, in the axes of their joints: at one place, or at a fixed distance.
struct Closure {
    bool is_ball;
    pin::JointIndex joints[2];
    Vector3d points[2];
    /// Coordinates above one of the bodies only, by body.
    std::vector<Eigen::Index> columns[2];
};

struct State {
    VectorXd q, v;
    /// Accelerations of the centres of mass and of the angles, ground axes.
    std::vector<Vector3d> linear, angular;
};

struct Mechanism {
    pin::Model model;
    std::vector<Body> bodies;
    std::vector<Closure> closures;
    std::vector<State> states;
};

Vector3d vector(std::istream &in) {
    Vector3d x;
    in >> x[0] >> x[1] >> x[2];
    return x;
}

pin::JointModel joint(const std::string &type) {
    if (type == "free") return pin::JointModelFreeFlyer();
    if (type == "spherical") return pin::JointModelSpherical();
    if (type == "revolute x") return pin::JointModelRX();
    if (type == "revolute z") return pin::JointModelRZ();
    if (type == "translational y") return pin::JointModelPY();
    throw std::runtime_error("no joint " + type);
}

void read_model(const char *path, Mechanism &out) {
    std::ifstream in(path);
    std::string kind;
    out.model.gravity.linear(vector(in));
    while (in >> kind) {
        if (kind == "body") {
            pin::JointIndex parent;
            Body body;
            in >> parent >> std::ws;
            std::getline(in, body.type);
            const Vector3d place = vector(in);
            body.center = vector(in);
            double mass;
            Eigen::Matrix3d inertia;
            in >> mass;
            for (int i = 0; i < 9; ++i) in >> inertia(i / 3, i % 3);
            const pin::SE3 placement(Eigen::Matrix3d::Identity(), place);
            const std::string name = "body" + std::to_string(out.bodies.size() + 1);
            const auto added = out.model.addJoint(parent, joint(body.type), placement, name);
            out.model.appendBodyToJoint(added, pin::Inertia(mass, body.center, inertia));
            out.bodies.push_back(body);
        } else {
            Closure closure;
            closure.is_ball = kind == "ball";
            for (int side = 0; side < 2; ++side) {
                in >> closure.joints[side];
                closure.points[side] = vector(in);
            }
            std::vector<Eigen::Index> above[2];
            for (int side = 0; side < 2; ++side) {
                for (const auto j : out.model.supports[closure.joints[side]]) {
                    const auto &joint = out.model.joints[j];
                    for (int k = 0; j > 0 && k < joint.nv(); ++k) {
                        above[side].push_back(joint.idx_v() + k);
                    }
                }
            }
            for (int side = 0; side < 2; ++side) {
                const auto &own = above[side], &other = above[1 - side];
                std::set_difference(own.begin(), own.end(), other.begin(), other.end(),
                                    std::back_inserter(closure.columns[side]));
            }
            out.closures.push_back(closure);
        }
    }
}

/// Pose of a body with first or second rates, from 3 or 7 numbers.
struct Motion {
    Vector3d place;
    Eigen::Quaterniond turn;
};

Motion read_motion(std::istream &in, int per_body) {
    Motion out;
    if (per_body == 3) {
        double angle;
        in >> out.place[0] >> out.place[1] >> angle;
        out.place[2] = 0.0;
        // Of rates the angle itself.
        out.turn = Eigen::Quaterniond(0.0, 0.0, 0.0, angle);
    } else {
        out.place = vector(in);
        double e[4];
        for (double &x : e) in >> x;
        out.turn = Eigen::Quaterniond(e[0], e[1], e[2], e[3]);
    }
    return out;
}

/// Joint coordinates from poses of bodies with their rates.
State read_state(std::istream &in, int per_body, const Mechanism &mechanism) {
    const auto &model = mechanism.model;
    const std::size_t count = mechanism.bodies.size();
    std::vector<Motion> levels[3];
    for (auto &level : levels) {
        for (std::size_t b = 0; b < count; ++b) level.push_back(read_motion(in, per_body));
    }
    State out{VectorXd::Zero(model.nq), VectorXd::Zero(model.nv), {}, {}};
    std::vector<pin::SE3> poses(1, pin::SE3::Identity());
    std::vector<pin::Motion> twists(1, pin::Motion::Zero());
    for (std::size_t b = 0; b < count; ++b) {
        const auto &[pose, rate, second] = std::tie(levels[0][b], levels[1][b], levels[2][b]);
        Eigen::Matrix3d axes;
        Vector3d turning, turning_rate;
        if (per_body == 3) {
            axes = Eigen::AngleAxisd(pose.turn.z(), Vector3d::UnitZ()).toRotationMatrix();
            turning = rate.turn.vec();
            turning_rate = second.turn.vec();
        } else {
            axes = pose.turn.toRotationMatrix();
            turning = 2.0 * (rate.turn * pose.turn.conjugate()).vec();
            turning_rate = 2.0 * (second.turn * pose.turn.conjugate()).vec();
        }
        out.linear.push_back(second.place);
        out.angular.push_back(turning_rate);
        const Vector3d arm = axes * mechanism.bodies[b].center;
        const Vector3d speed = rate.place - turning.cross(arm);
        poses.emplace_back(axes, pose.place - arm);
        twists.emplace_back(axes.transpose() * speed, axes.transpose() * turning);
        const auto &joint = model.joints[b + 1];
        const auto parent = model.parents[b + 1];
        const pin::SE3 between = poses[parent].actInv(poses[b + 1]);
        const pin::SE3 relative = model.jointPlacements[b + 1].actInv(between);
        const pin::Motion moving = twists[b + 1] - between.actInv(twists[parent]);
        const auto &r = relative.rotation();
        const Eigen::Quaterniond turn(r);
        auto q = out.q.segment(joint.idx_q(), joint.nq());
        auto v = out.v.segment(joint.idx_v(), joint.nv());
        const std::string &type = mechanism.bodies[b].type;
        if (type == "free") {
            q << relative.translation(), turn.coeffs();
            v = moving.toVector();
        } else if (type == "spherical") {
            q = turn.coeffs();
            v = moving.angular();
        } else if (type == "revolute x") {
            q[0] = std::atan2(r(2, 1), r(1, 1));
            v[0] = moving.angular()[0];
        } else if (type == "revolute z") {
            q[0] = std::atan2(r(1, 0), r(0, 0));
            v[0] = moving.angular()[2];
        } else {
            q[0] = relative.translation()[1];
            v[0] = moving.linear()[1];
        }
    }
    return out;
}

void read_states(const char *path, Mechanism &out) {
    std::ifstream in(path);
    int per_body;
    in >> per_body;
    while (in >> std::ws && in.peek() != EOF) {
        out.states.push_back(read_state(in, per_body, out));
    }
}

/// Acceleration of a point of a body, ground axes.
Vector3d acceleration(const pin::Data &data, pin::JointIndex joint, const Vector3d &point) {
    const auto &v = data.v[joint], &a = data.a[joint];
    const Vector3d own = v.linear() + v.angular().cross(point);
    return data.oMi[joint].rotation() *
           (a.linear() + a.angular().cross(point) + v.angular().cross(own));
}

/// Accelerations with a row for each equation that closes a loop: Pinocchio's mass matrix, Jacobians, bias and
/// its solver for given rows. Its constraints are points and frames; rods of fixed length have to be given.
class GivenRows {
  public:
    explicit GivenRows(const Mechanism &mechanism)
        : mechanism(mechanism), zero(VectorXd::Zero(mechanism.model.nv)) {
        Eigen::Index count = 0;
        for (const auto &closure : mechanism.closures) count += closure.is_ball ? 3 : 1;
        rows = Eigen::MatrixXd::Zero(count, mechanism.model.nv);
        drift = VectorXd::Zero(count);
    }

    const VectorXd &solve(pin::Data &data, const Given &q, const Given &v, const Given &tau) {
        const auto &model = mechanism.model;
        pin::forwardKinematics(model, data, q, v, Given(zero));
        pin::computeJointJacobians(model, data);
        Eigen::Index at = 0;
        for (const auto &closure : mechanism.closures) {
            const auto [i, j] = std::tie(closure.joints[0], closure.joints[1]);
            const Vector3d places[2] = {data.oMi[i].act(closure.points[0]),
                                        data.oMi[j].act(closure.points[1])};
            Vector3d bend = acceleration(data, i, closure.points[0]) -
                            acceleration(data, j, closure.points[1]);
            if (closure.is_ball) {
                drift.segment<3>(at) = bend;
            } else {
                const Vector3d apart = places[0] - places[1];
                const Vector3d speed = velocity(data, i, closure.points[0]) -
                                       velocity(data, j, closure.points[1]);
                drift[at] = apart.dot(bend) + speed.squaredNorm();
            }
            for (int side = 0; side < 2; ++side) {
                const double sign = side == 0 ? 1.0 : -1.0;
                for (const auto k : closure.columns[side]) {
                    const Vector3d angular = data.J.col(k).tail<3>();
                    const Vector3d moved =
                        sign * (data.J.col(k).head<3>() + angular.cross(places[side]));
                    if (closure.is_ball) {
                        rows.col(k).segment<3>(at) = moved;
                    } else {
                        rows(at, k) = (places[0] - places[1]).dot(moved);
                    }
                }
            }
            at += closure.is_ball ? 3 : 1;
        }
        pin::crba(model, data, q, pin::Convention::WORLD);
        pin::nonLinearEffects(model, data, q, v);
        return pin::forwardDynamics(model, data, tau, rows, drift);
    }

  private:
    static Vector3d velocity(const pin::Data &data, pin::JointIndex joint, const Vector3d &point) {
        const auto &v = data.v[joint];
        return data.oMi[joint].rotation() * (v.linear() + v.angular().cross(point));
    }

    const Mechanism &mechanism;
    VectorXd zero, drift;
    Eigen::MatrixXd rows;
};

double seconds() {
    timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return double(now.tv_sec) + 1e-9 * double(now.tv_nsec);
}

using Solve = std::function<const VectorXd &(const State &)>;

/// Prints a method, microseconds of processor time of one evaluation, and the largest difference of
/// accelerations against the largest one, of bodies.
void measure(const std::string &method, const Mechanism &mechanism, const Solve &solve) {
    double largest = 0.0, off = 0.0;
    pin::Data data(mechanism.model);
    for (const auto &state : mechanism.states) {
        const VectorXd a = solve(state);
        pin::forwardKinematics(mechanism.model, data, state.q, state.v, a);
        for (std::size_t b = 0; b < mechanism.bodies.size(); ++b) {
            const Vector3d linear = acceleration(data, b + 1, mechanism.bodies[b].center);
            const Vector3d angular = data.oMi[b + 1].rotation() * data.a[b + 1].angular();
            for (const auto &[found, truth] :
                 {std::pair(linear, state.linear[b]), std::pair(angular, state.angular[b])}) {
                largest = std::max(largest, truth.lpNorm<Eigen::Infinity>());
                off = std::max(off, (found - truth).lpNorm<Eigen::Infinity>());
            }
        }
    }
    std::vector<double> times;
    for (int passes = 1; times.size() < ROUNDS;) {
        const double start = seconds();
        for (int pass = 0; pass < passes; ++pass) {
            for (const auto &state : mechanism.states) solve(state);
        }
        const double took = seconds() - start;
        if (took < ROUND_SECONDS) {
            passes *= 2;
        } else {
            times.push_back(1e6 * took / double(passes * mechanism.states.size()));
        }
    }
    std::sort(times.begin(), times.end());
    std::printf("%s,%.4f,%.1e\n", method.c_str(), times[ROUNDS / 2], off / largest);
}

int main(int, char **arguments) {
    Mechanism mechanism;
    read_model(arguments[1], mechanism);
    read_states(arguments[2], mechanism);
    const auto &model = mechanism.model;
    pin::Data data(model);
    const VectorXd zero = VectorXd::Zero(model.nv);
    const Given tau(zero);
    if (mechanism.closures.empty()) {
        for (const auto &[name, convention] : {std::pair("aba, local", pin::Convention::LOCAL),
                                               std::pair("aba, world", pin::Convention::WORLD)}) {
            measure(name, mechanism, [&](const State &state) -> const VectorXd & {
                return pin::aba(model, data, Given(state.q), Given(state.v), tau, convention);
            });
        }
        return 0;
    }
    GivenRows given(mechanism);
    measure("forwardDynamics of given rows", mechanism, [&](const State &s) -> const VectorXd & {
        return given.solve(data, s.q, s.v, tau);
    });
    // For rods, too, points at one place: three equations instead of one, and other accelerations.
    const auto is_ball = [](const Closure &closure) { return closure.is_ball; };
    const auto &closures = mechanism.closures;
    const bool is_same = std::all_of(closures.begin(), closures.end(), is_ball);
    const auto name = [&](const std::string &method) {
        return is_same ? method : method + " with points for rods";
    };
    std::vector<pin::RigidConstraintModel> constraints;
    for (const auto &closure : mechanism.closures) {
        const auto place = [&](int side) {
            return pin::SE3(Eigen::Matrix3d::Identity(), closure.points[side]);
        };
        constraints.emplace_back(pin::CONTACT_3D, model, closure.joints[0], place(0),
                                 closure.joints[1], place(1));
    }
    std::vector<pin::RigidConstraintData> constraint_data;
    for (const auto &constraint : constraints) constraint_data.emplace_back(constraint);
    pin::initConstraintDynamics(model, data, constraints, constraint_data);
    measure(name("constraintDynamics"), mechanism, [&](const State &s) -> const VectorXd & {
        return pin::constraintDynamics(model, data, Given(s.q), Given(s.v), tau, constraints,
                                       constraint_data);
    });
    return 0;
}
