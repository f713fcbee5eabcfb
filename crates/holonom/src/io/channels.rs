//! Output channels of a file against those that its model has.

use super::names::suggest;
use crate::error::{Code, Diagnostic};
use crate::simulation::Problem;

/// One error for every output channel that a problem does not have.
pub(super) fn unknown_channels(problem: &Problem) -> Vec<Diagnostic> {
    let mut errors = Vec::new();
    for (i, wanted) in problem.model().outputs.channels.iter().enumerate() {
        if is_there(problem, wanted) {
            continue;
        }
        let path = format!("outputs.channels[{i}]");
        let Some((item, quantity)) = wanted.split_once('.') else { continue };
        let of_item = |name| match item {
            "*" => str::split_once(name, '.').map(|(_, quantity)| quantity),
            _ => name.strip_prefix(item)?.strip_prefix('.'),
        };
        let known: indexmap::IndexSet<&str> =
            problem.channels().iter().filter_map(|channel| of_item(&channel.name)).collect();
        let whole = quantity.split('[').next().unwrap_or_default();
        let (message, help) = match problem.channel(&format!("{item}.{whole}")) {
            Some(channel) if whole != quantity => (
                format!(
                    "`{path}` names a component that `{item}.{whole}` does not have: {wanted:?}"
                ),
                match channel.size() {
                    1 => "leave the index out".to_owned(),
                    size => format!("components count from 0: take one up to {}", size - 1),
                },
            ),
            _ => (
                format!("`{path}` names the channel `{wanted}`, which is not there"),
                suggest(&errors, quantity, "quantities", known.iter().copied()),
            ),
        };
        errors.push(Diagnostic::new(Code::UnknownName, path, message).help(help));
    }
    errors
}

/// Whether a name is that of a channel or of a component, or a pattern that fits one.
fn is_there(problem: &Problem, wanted: &str) -> bool {
    let of_item = wanted.split_once('.').is_some_and(|(_, quantity)| quantity == "*");
    if of_item || problem.channel(wanted).is_some() {
        return true; // every item has quantities, and that it is there was seen before
    }
    if let Some((name, index)) = wanted.strip_suffix(']').and_then(|w| w.rsplit_once('['))
        && let Ok(index) = index.parse::<usize>()
    {
        let vector = problem.channel(name).filter(|channel| channel.shape.len() == 1);
        return vector.is_some_and(|channel| index < channel.size());
    }
    wanted.contains('*') && problem.channels().iter().any(|channel| fits(wanted, &channel.name))
}

/// Whether a name fits a pattern, in which `*` stands for any text.
fn fits(pattern: &str, name: &str) -> bool {
    let Some((start, rest)) = pattern.split_once('*') else { return pattern == name };
    let (middle, end) = rest.rsplit_once('*').unwrap_or(("", rest));
    let inner = name.strip_prefix(start).and_then(|name| name.strip_suffix(end));
    // Where a part fits first is as good as anywhere later.
    let parts = middle.split('*').filter(|part| !part.is_empty());
    inner.is_some_and(|inner| {
        let after =
            |left: &mut &str, part: &str| left.split_once(part).map(|(_, tail)| *left = tail);
        let mut left = inner;
        parts.into_iter().all(|part| after(&mut left, part).is_some())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // truth: the rule, by hand
    fn a_star_stands_for_any_text() {
        for (pattern, name, truth) in [
            ("*.position", "arm.position", true),
            ("*.position", "arm.seat.position", true),
            ("*.position", "arm.velocity", false),
            ("arm.*city", "arm.angular_velocity", true),
            ("arm.p*n", "arm.position", true),
            ("arm.p*x", "arm.position", false),
            ("*", "ärm.x", true),
        ] {
            assert_eq!(fits(pattern, name), truth, "{pattern} {name}");
        }
    }
}
