//! Output channels of a file against those that its model has.

use super::names::{ERRORS_WITH_HELP, nearest, suggest};
use crate::error::{Code, Diagnostic};
use crate::simulation::Problem;
use glob::Pattern;

/// Characters that make a pattern of a name.
pub(super) const PATTERN: [char; 3] = ['*', '?', '['];

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
            _ if item.contains(PATTERN) => str::split_once(name, '.').map(|(_, quantity)| quantity),
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
                match nearest(whole, known.iter().copied()) {
                    _ if wanted.contains(PATTERN) && pattern(wanted).is_none() => {
                        "its `[` has no `]`, or nothing before it: `[ab]` stands for one of these characters".to_owned()
                    }
                    _ if fits_none(problem, item) => format!("no item has a name like `{item}`"),
                    Some(meant) if errors.len() < ERRORS_WITH_HELP => {
                        let component = format!("{item}.{meant}{}", &quantity[whole.len()..]);
                        let fits = component.ends_with(']') && is_there(problem, &component);
                        let meant = if fits { component } else { format!("{item}.{meant}") };
                        format!("did you mean `{meant}`?")
                    }
                    _ => suggest(&errors, quantity, "quantities", known.iter().copied()),
                },
            ),
        };
        errors.push(Diagnostic::new(Code::UnknownName, path, message).help(help));
    }
    errors
}

/// Whether an item's name is a pattern, and that of no item.
fn fits_none(problem: &Problem, item: &str) -> bool {
    let items = || problem.channels().iter().filter_map(|channel| channel.name.rsplit_once('.'));
    item.contains(PATTERN)
        && Pattern::new(item).is_ok_and(|pattern| !items().any(|(item, _)| pattern.matches(item)))
}

/// Whether a name is that of a channel or of a component, or a pattern that fits one.
fn is_there(problem: &Problem, wanted: &str) -> bool {
    let of_item = |(item, quantity): (&str, &str)| quantity == "*" && !item.contains(PATTERN);
    let of_item = wanted.split_once('.').is_some_and(of_item);
    if of_item || problem.channel(wanted).is_some() {
        return true; // every item has quantities, and that it is there was seen before
    }
    if let Some((name, index)) = wanted.strip_suffix(']').and_then(|w| w.rsplit_once('['))
        && index.bytes().all(|digit| digit.is_ascii_digit())
        && let Ok(index) = index.parse::<usize>()
    {
        let vector = problem.channel(name).filter(|channel| channel.shape.len() == 1);
        return vector.is_some_and(|channel| index < channel.size());
    }
    let Some(pattern) = pattern(wanted) else { return false };
    problem.channels().iter().any(|channel| pattern.matches(&channel.name))
}

/// The pattern of a name with `*`, `?` or `[…]` in it.
fn pattern(name: &str) -> Option<Pattern> {
    // Two stars are folders to the library, one to users.
    let parts = name.split('*').filter(|part| !part.is_empty()).collect::<Vec<_>>();
    let star = |there: bool| if there { "*" } else { "" };
    let single = [
        star(name.starts_with('*')),
        &parts.join("*"),
        star(name.ends_with('*') && name.len() > 1),
    ];
    let is_pattern = name.contains(PATTERN);
    is_pattern.then(|| Pattern::new(&single.concat()).ok()).flatten()
}

#[cfg(test)]
mod tests {

    #[test] // truth: the rule, by hand
    fn patterns_fit_what_they_stand_for() {
        for (pattern, name, truth) in [
            ("*.position", "arm.position", true),
            ("*.position", "arm.seat.position", true),
            ("*.position", "arm.velocity", false),
            ("arm.*city", "arm.angular_velocity", true),
            ("arm.p*n", "arm.position", true),
            ("arm.p*x", "arm.position", false),
            ("*", "ärm.x", true),
            ("**.x", "arm.x", true),
            ("a**m.*", "arm.x", true),
            ("arm.posi[t]ion", "arm.position", true),
            ("arm.posi[!t]ion", "arm.position", false),
            ("ar?.position", "arm.position", true),
            ("ar?.position", "ar.position", false),
            ("arm.[position", "arm.[position", false),
            ("arm.[]position", "arm.]position", false),
        ] {
            let fits = super::pattern(pattern).is_some_and(|pattern| pattern.matches(name));
            assert_eq!(fits, truth, "{pattern} {name}");
        }
    }
}
