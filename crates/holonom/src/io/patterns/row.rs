//! One repetition: numbers put into names, texts and expressions.

use std::cell::Cell;

use crate::error::Code;
use crate::io::expression::{Fault, filled, with_numbers};
use crate::io::parameters::Parameters;
use crate::io::tree::{Entry, Node, Step, Table, Value, path_of};

/// Why something cannot be repeated: the path below the item, and the reason.
pub(super) struct Trouble {
    pub(super) path: String,
    pub(super) code: Code,
    pub(super) fault: Fault,
}

/// Names with a value at one repetition.
pub(super) struct Row<'a> {
    pub(super) parameters: &'a Parameters,
    pub(super) broken: &'a Cell<bool>,
    pub(super) names: &'a [String],
    pub(super) values: &'a [i64],
}

impl Row<'_> {
    fn index(&self, name: &str) -> Option<i64> {
        self.names
            .iter()
            .zip(self.values)
            .find(|(known, _)| *known == name)
            .map(|(_, value)| *value)
    }

    pub(super) fn value(&self, name: &str) -> Option<f64> {
        if let Some(index) = self.index(name) {
            return Some(index as f64);
        }
        let mut broken = self.broken.get();
        let value = self.parameters.number(name, &mut broken);
        self.broken.set(broken);
        value
    }

    pub(super) fn name(&self, text: &str) -> Result<String, Fault> {
        if !text.contains(['{', '}']) {
            return Ok(text.to_owned());
        }
        filled(text, &mut |name| self.value(name))
    }

    fn text(&self, text: &str) -> Result<String, Fault> {
        let text = self.name(text)?;
        Ok(match text.strip_prefix('=') {
            Some(expression) if !self.parameters.contains(expression.trim()) => {
                "=".to_owned() + &with_numbers(expression, &|name| self.index(name))
            }
            _ => text,
        })
    }

    pub(super) fn node(&self, node: &Node) -> Result<Node, Trouble> {
        let fail = |fault| Trouble { path: String::new(), code: Code::Expression, fault };
        let below = |step: Step| {
            move |mut trouble: Trouble| {
                let dot =
                    if trouble.path.is_empty() || trouble.path.starts_with('[') { "" } else { "." };
                trouble.path = path_of(&[step]) + dot + &trouble.path;
                trouble
            }
        };
        let value = match &node.value {
            Value::Text(text) => Value::Text(self.text(text).map_err(fail)?),
            Value::List(list) => {
                let entries = list.iter().enumerate();
                let filled = entries.map(|(i, n)| self.node(n).map_err(below(Step::Index(i))));
                Value::List(filled.collect::<Result<_, _>>()?)
            }
            Value::Table(table) => {
                let mut out = Table::with_capacity(table.len());
                for (key, entry) in table {
                    let step = || below(Step::Field(key.clone()));
                    let name = self.name(key).map_err(fail).map_err(step())?;
                    let node = self.node(&entry.node).map_err(step())?;
                    if out.contains_key(&name) {
                        let message = format!("the name `{name}` is made twice");
                        let fault = Fault::Other(message, String::new());
                        let path = String::new();
                        return Err(step()(Trouble { path, code: Code::DuplicateName, fault }));
                    }
                    out.insert(name, Entry { key: entry.key, node });
                }
                Value::Table(out)
            }
            plain => plain.clone(),
        };
        Ok(Node { value, span: node.span })
    }
}

/// Values of a part of the tree, as limits count them.
pub(super) fn size(node: &Node) -> usize {
    1 + match &node.value {
        Value::Text(text) => text.len() / 64,
        Value::List(list) => list.iter().map(size).sum(),
        Value::Table(table) => {
            table.iter().map(|(key, entry)| key.len() / 64 + size(&entry.node)).sum()
        }
        _ => 0,
    }
}
