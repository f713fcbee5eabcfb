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
    /// Those that depend on themselves, or on one that does.
    circular: BTreeSet<String>,
}

impl Parameters {
    /// Of a whole file: first those that are numbers, then those that need no others than are known.
    pub(super) fn of(root: &Node) -> Self {
        let mut out = Self::default();
        let Some(table) = root.field("parameters").and_then(Node::table) else { return out };
        let value = |name: &str| table.get(name).and_then(|entry| entry.node.field("value"));
        let mut needed_by: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        let mut waiting_for: BTreeMap<&str, usize> = BTreeMap::new();
        let mut ready = Vec::new();
        for name in table.keys() {
            let needs = value(name).map(|node| needed(node, |other| table.contains_key(other)));
            let needs = needs.unwrap_or_default();
            let count = needs.len();
            needs.into_iter().for_each(|other| needed_by.entry(other).or_default().push(name));
            waiting_for.insert(name, count);
            if count == 0 {
                ready.push(name.as_str());
            }
        }
        while let Some(name) = ready.pop() {
            out.values.insert(name.to_owned(), value(name).and_then(|node| out.value_of(node)));
            for &other in needed_by.get(name).into_iter().flatten() {
                let waiting = waiting_for.entry(other).or_default();
                *waiting -= 1;
                if *waiting == 0 {
                    ready.push(other);
                }
            }
        }
        out.circular = table.keys().filter(|n| !out.values.contains_key(*n)).cloned().collect();
        out.values.extend(out.circular.iter().map(|name| (name.clone(), None)));
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
