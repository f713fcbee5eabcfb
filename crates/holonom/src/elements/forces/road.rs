use crate::math::Real;
use crate::model::Road;

/// h, h_x, h_xx of the road under a wheel of the given unloaded radius.
#[inline(always)]
pub(super) fn height<T: Real>(road: &Road, wheel_radius: f64, x: T) -> [T; 3] {
    let flat = [T::zero(); 3];
    match *road {
        Road::Flat { height } => [T::from(height), T::zero(), T::zero()],
        Road::SmoothBump { height, half_length, center } => {
            let s = (x - center) / half_length;
            let m = T::one() - s * s;
            if m.value() <= 0.0 {
                return flat;
            }
            let slope = s * m * m * (-6.0 * height / half_length);
            let curvature = m * (s * s * 5.0 - 1.0) * (6.0 * height / (half_length * half_length));
            [m * m * m * height, slope, curvature]
        }
        Road::HalfCylinder { radius, center } => {
            let (s, path) = (x - center, radius + wheel_radius);
            let square = T::from(path * path) - s * s;
            if square.value() <= wheel_radius * wheel_radius {
                return flat;
            }
            let root = square.sqrt();
            [root - wheel_radius, -s / root, -(square.recip() * (path * path)) / root]
        }
    }
}

/// Time in which a wheel at x with speed ẋ comes well into the obstacle of the road, s: a quarter of
/// its length. A longer step from a smooth ride could begin before it and end behind it without
/// any stage on it. Infinite where no obstacle lies ahead.
pub(super) fn time_into_obstacle(road: &Road, wheel_radius: f64, x: f64, speed: f64) -> f64 {
    let Some((center, half_length)) = obstacle(road, wheel_radius) else {
        return f64::INFINITY;
    };
    let ahead = (center - x) * speed.signum();
    if speed == 0.0 || ahead < -half_length {
        return f64::INFINITY;
    }
    ((ahead - half_length).max(0.0) + 0.5 * half_length) / speed.abs()
}

/// Centre and half the length of the obstacle on the road, if there is one, for a wheel centre.
fn obstacle(road: &Road, wheel_radius: f64) -> Option<(f64, f64)> {
    match *road {
        Road::Flat { .. } => None,
        Road::SmoothBump { half_length, center, .. } => Some((center, half_length)),
        Road::HalfCylinder { radius, center } => {
            Some((center, (radius * (radius + 2.0 * wheel_radius)).sqrt()))
        }
    }
}

/// Ends, quarters and middle of the obstacle.
pub(super) fn knots(road: &Road, wheel_radius: f64) -> Option<Vec<f64>> {
    let (center, half_length) = obstacle(road, wheel_radius)?;
    Some([-1.0, -0.5, 0.0, 0.5, 1.0].map(|part| center + part * half_length).to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Random, richardson};

    const ROADS: [Road; 3] = [
        Road::Flat { height: 0.1 },
        Road::SmoothBump { height: 0.05, half_length: 0.35, center: 4.2335 },
        Road::HalfCylinder { radius: 0.05, center: 4.2335 },
    ];

    #[test] // independent truth: differences of the height
    fn slope_and_curvature_are_derivatives_of_the_height() {
        let mut random = Random::new(3);
        for road in &ROADS {
            for _ in 0..200 {
                let x = 4.2335 + random.range(-0.2, 0.2);
                let [_, slope, curvature] = height(road, 0.4699, x);
                let found = richardson(1e-4, |s| {
                    let [h, h_x, _] = height(road, 0.4699, x + s);
                    vec![h, h_x]
                });
                assert!((found[0] - slope).abs() < 1e-9, "{road:?} {x}");
                assert!((found[1] - curvature).abs() < 1e-7, "{road:?} {x}");
            }
        }
    }

    #[test] // independent truth: the height at the end of the step
    fn a_step_that_reaches_an_obstacle_ends_on_it() {
        for road in &ROADS[1..] {
            for (x, speed) in [(-10.0, 20.0), (4.0, 3.0), (15.0, -0.5)] {
                let end = x + speed * time_into_obstacle(road, 0.4699, x, speed);
                assert!(height(road, 0.4699, end)[0] > 0.01, "{road:?} {x} {speed}: {end}");
                assert_eq!(time_into_obstacle(road, 0.4699, x, 0.0), f64::INFINITY);
            }
            for (x, speed) in [(-10.0, -20.0), (15.0, 0.5)] {
                assert_eq!(time_into_obstacle(road, 0.4699, x, speed), f64::INFINITY);
            }
        }
    }

    #[test] // independent truth: the height
    fn knots_enclose_the_obstacle() {
        assert_eq!(knots(&ROADS[0], 0.4699), None);
        for road in &ROADS[1..] {
            let knots = knots(road, 0.4699).unwrap();
            assert!(knots.is_sorted());
            for (end, inwards) in [(knots[0], 1e-3), (knots[4], -1e-3)] {
                assert_eq!(height(road, 0.4699, end - inwards)[0], 0.0, "{road:?}");
                assert!(height(road, 0.4699, end + inwards)[0] > 0.0, "{road:?}");
            }
        }
    }

    #[test] // independent truth: values worked out by hand
    fn heights_are_those_of_the_profiles() {
        let at = |road: &Road, x: f64| height(road, 0.4699, x)[0];
        assert!((at(&ROADS[1], 4.2335) - 0.05).abs() < 1e-15);
        assert!((at(&ROADS[1], 4.2335 + 0.175) - 0.05 * 0.75_f64.powi(3)).abs() < 1e-15);
        assert_eq!(at(&ROADS[1], 4.2335 + 0.36), 0.0);
        assert!((at(&ROADS[2], 4.2335) - 0.05).abs() < 1e-15);
        let edge = (0.5199_f64.powi(2) - 0.4699_f64.powi(2)).sqrt();
        assert!(at(&ROADS[2], 4.2335 + edge - 1e-6) > 0.0);
        assert_eq!(at(&ROADS[2], 4.2335 + edge + 1e-6), 0.0);
        assert_eq!(at(&ROADS[2], 100.0), 0.0);
    }
}
