//! Values of the parameters of a file, which may be expressions of each other.

use std::collections::{BTreeMap, BTreeSet};

use super::expression::{evaluate, names};
use super::limits;
use super::tree::{Node, Value};

/// Parameters by name.
#[derive(Debug, Default)]
pub(super) struct Parameters {
    /// `None` where there is no number, which is reported at its place.
    values: BTreeMap<String, Option<f64>>,
    /// Those that depend on themselves.
    circular: BTreeSet<String>,
}

impl Parameters {
    /// Of a whole file: first those that are numbers, then those that need no others than are known.
    pub(super) fn of(root: &Node) -> Self {
        let mut out = Self::default();
        let Some(table) = root.field("parameters").and_then(Node::table) else { return out };
        let value = |name: &str| table.get(name).and_then(|entry| entry.node.field("value"));
        let mut needs = Links::new();
        let mut needed_by: Links<'_> =
            table.keys().map(|name| (name.as_str(), Vec::new())).collect();
        for name in table.keys() {
            let known = |other: &str| table.contains_key(other);
            let own = value(name).map_or_else(BTreeSet::new, |node| needed(node, known));
            for &other in &own {
                needed_by.entry(other).or_default().push(name);
            }
            needs.insert(name, own.into_iter().collect());
        }
        let left = peeled(&needs, &needed_by, |name| {
            out.values.insert(name.to_owned(), value(name).and_then(|node| out.value_of(node)));
        });
        out.values.extend(left.iter().map(|name| ((*name).to_owned(), None)));
        // What only follows from a circle is no part of it.
        for links in [&mut needs, &mut needed_by] {
            links.retain(|name, _| left.contains(name));
            links.values_mut().for_each(|others| others.retain(|name| left.contains(name)));
        }
        let circular = peeled(&needed_by, &needs, |_| {});
        out.circular = circular.into_iter().map(str::to_owned).collect();
        out
    }

    fn value_of(&self, node: &Node) -> Option<f64> {
        match &node.value {
            Value::Number(x) => Some(*x),
            Value::Text(text) => {
                let mut broken = false;
                let expression = text.strip_prefix('=')?;
                let value = evaluate(expression, &mut |name| self.number(name, &mut broken));
                value.ok().filter(|x| !broken && x.abs() <= limits::NUMBER)
            }
            _ => None,
        }
    }

    /// The value of a parameter that is there; where it has none any number, which is `broken` then.
    pub(super) fn number(&self, name: &str, broken: &mut bool) -> Option<f64> {
        let value = self.values.get(name)?;
        *broken |= value.is_none();
        Some(value.unwrap_or(1.0))
    }

    pub(super) fn contains(&self, name: &str) -> bool {
        self.values.contains_key(name)
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> + Clone {
        self.values.keys().map(String::as_str)
    }

    pub(super) fn is_circular(&self, name: &str) -> bool {
        self.circular.contains(name)
    }
}

type Links<'a> = BTreeMap<&'a str, Vec<&'a str>>;

/// Visits names one after the other once none that they wait `for_others` is left, `others` being who waits for each; returns
/// those that are never visited.
fn peeled<'a>(
    for_others: &Links<'a>,
    others: &Links<'a>,
    mut visit: impl FnMut(&'a str),
) -> BTreeSet<&'a str> {
    let mut waiting: BTreeMap<&str, usize> =
        for_others.iter().map(|(name, others)| (*name, others.len())).collect();
    let mut ready: Vec<&str> =
        waiting.iter().filter(|(_, count)| **count == 0).map(|(name, _)| *name).collect();
    while let Some(name) = ready.pop() {
        waiting.remove(name);
        visit(name);
        for other in others.get(name).into_iter().flatten() {
            let count = waiting.entry(other).or_default();
            *count -= 1;
            if *count == 0 {
                ready.push(other);
            }
        }
    }
    waiting.into_keys().collect()
}

/// Known names in an expression; one that is a name as a whole is that name.
fn needed(node: &Node, is_known: impl Fn(&str) -> bool) -> BTreeSet<&str> {
    let mut out = BTreeSet::new();
    let Some(expression) = node.text().and_then(|text| text.strip_prefix('=')) else { return out };
    if is_known(expression.trim()) {
        out.insert(expression.trim());
        return out;
    }
    names(expression, &mut |name, _| {
        if is_known(name) {
            out.insert(name);
        }
    });
    out
}
