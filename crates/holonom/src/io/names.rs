//! Names: what they may contain, and which one was meant.

use super::limits::NAME_CHARACTERS;

/// Names that mean something by themselves in paths and channels.
const RESERVED: [&str; 5] = ["ground", "energy", "constraint", "time", "state"];

/// Why a name cannot be given to an item, if so.
pub(super) fn objection(name: &str) -> Option<String> {
    let allowed = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
    if name.is_empty() {
        Some("a name cannot be empty".to_owned())
    } else if RESERVED.contains(&name) {
        Some(format!("the name `{name}` is reserved"))
    } else if name.chars().count() > NAME_CHARACTERS {
        Some(format!("a name has at most {NAME_CHARACTERS} characters"))
    } else {
        let c = name.chars().find(|&c| !allowed(c))?;
        Some(format!("a name cannot contain {c:?}"))
    }
}

/// Words of other programs for fields of a model file, and for methods; the first that a table knows is meant.
const WORDS_OF_OTHERS: [(&str, &[&str]); 22] = [
    ("angular_velocity", &["omega", "w", "rpm", "spin", "rate", "angular_speed"]),
    ("velocity", &["v", "vel", "speed", "rate"]),
    ("position", &["pos", "r", "origin", "location", "translation"]),
    ("angle", &["theta", "phi", "rotation", "rot"]),
    ("axis_angle", &["orientation", "rotation", "rot"]),
    ("euler_parameters", &["quaternion", "quat", "orientation"]),
    ("displacement", &["position", "x", "s", "distance"]),
    ("center_of_mass", &["com", "cog", "cg", "cm"]),
    ("inertia", &["j", "i", "moment_of_inertia", "tensor"]),
    ("mass", &["m"]),
    ("stiffness", &["k", "spring_constant", "rate"]),
    ("damping", &["c", "d", "b", "damper", "viscosity"]),
    ("free_length", &["l0", "rest_length", "natural_length"]),
    ("tolerance", &["tol", "rtol", "atol", "eps", "accuracy"]),
    ("fixed_step", &["dt", "h", "step", "step_size", "time_step"]),
    (
        "ForRadau",
        &[
            "radau", "radau5", "bdf", "lsoda", "ode15s", "cvode", "ida", "dassl", "implicit",
            "stiff",
        ],
    ),
    ("ForSDIRK", &["sdirk", "sdirk4", "esdirk"]),
    (
        "SspTrap",
        &["trapezoidal", "newmark", "crank-nicolson", "hht", "generalized-alpha", "midpoint"],
    ),
    ("DOPRI5", &["rk45", "ode45", "rkf45", "rk4", "dopri", "euler", "runge-kutta"]),
    ("DOP853", &["dop8", "rk8", "rk87", "ode78", "ode89", "vern8", "rkf78"]),
    ("DEABM", &["adams", "ab", "abm", "ode113", "predictor-corrector"]),
    ("end_time", &["tend", "t_end", "tf", "tfinal", "t_final", "duration", "stop_time"]),
];

/// The candidate that a misspelled name, or one of other programs, most likely means.
pub(super) fn nearest<'a>(
    name: &str,
    candidates: impl IntoIterator<Item = &'a str>,
) -> Option<&'a str> {
    let lower = name.to_lowercase();
    let mut best: Option<(f64, &str)> = None;
    let words = WORDS_OF_OTHERS.iter().filter(|(_, words)| words.contains(&lower.as_str()));
    let meant: Vec<&str> = words.map(|(field, _)| *field).collect();
    for candidate in candidates.into_iter().take(COMPARED) {
        if meant.contains(&candidate) {
            return Some(candidate);
        }
        let score = strsim::normalized_damerau_levenshtein(&lower, &candidate.to_lowercase());
        // A name that is part of the other is meant more often than its distance says, if it is no mere letter.
        let part = name.len().min(candidate.len()) > 2
            && (candidate.contains(name) || name.contains(candidate));
        let score = if part { score.max(0.6) } else { score };
        if best.is_none_or(|(b, _)| score > b) {
            best = Some((score, candidate));
        }
    }
    best.filter(|&(score, _)| score >= 0.5).map(|(_, candidate)| candidate)
}

/// Names that are compared for one suggestion, and errors that get one: a large file with an error in
/// every line is answered at once too.
const COMPARED: usize = 10_000;
pub(super) const ERRORS_WITH_HELP: usize = 100;

/// Help for an unknown name, unless there are many errors already.
pub(super) fn suggest<'a>(
    errors: &[crate::error::Diagnostic],
    name: &str,
    what: &str,
    candidates: impl IntoIterator<Item = &'a str> + Clone,
) -> String {
    if errors.len() < ERRORS_WITH_HELP { suggestion(name, what, candidates) } else { String::new() }
}

/// Help for an unknown name: the nearest one, or all when they are few.
pub(super) fn suggestion<'a>(
    name: &str,
    what: &str,
    candidates: impl IntoIterator<Item = &'a str> + Clone,
) -> String {
    if let Some(meant) = nearest(name, candidates.clone()) {
        return format!("did you mean `{meant}`?");
    }
    let known: Vec<_> = candidates.into_iter().take(13).map(|name| format!("`{name}`")).collect();
    match known.len() {
        0 => format!("known {what}: none"),
        1..=12 => format!("known {what}: {}", known.join(", ")),
        _ => format!("known {what}: {}, …", known[..12].join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_the_one_a_person_means() {
        let known = ["between", "point", "points_in_body", "stiffness", "free_length"];
        for (typed, meant) in [
            ("pont", Some("point")),
            ("Stiffness", Some("stiffness")),
            ("stifness", Some("stiffness")),
            ("freelength", Some("free_length")),
            ("betwene", Some("between")),
            ("k", Some("stiffness")),
            ("L0", Some("free_length")),
            ("omega", None),
            ("colour", None),
            ("", None),
        ] {
            assert_eq!(nearest(typed, known), meant, "{typed}");
        }
    }

    #[test]
    fn names_that_paths_cannot_carry_are_refused() {
        for name in ["", "a.b", "a b", "a[0]", "ground", "=x", "a*"] {
            assert!(objection(name).is_some(), "{name}");
        }
        for name in ["a", "front_left-2", "Kurbel_übersetzt", "2nd"] {
            assert!(objection(name).is_none(), "{name}");
        }
    }
}
