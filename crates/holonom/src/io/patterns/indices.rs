//! Indices of patterns and the values they take.

use super::expander::Expander;
use super::row::Row;
use crate::error::{Code, shown};
use crate::io::expression::{Fault, evaluate, is_name, is_number};
use crate::io::limits;
use crate::io::names::objection;
use crate::io::patterns::expander::table_at;
use crate::io::tree::{Table, Value, join};

/// The indices of a pattern and all their values, row by row.
pub(super) struct Indices {
    pub(super) path: String,
    pub(super) names: Vec<String>,
    rows: Vec<i64>,
}

impl Indices {
    pub(super) fn len(&self) -> usize {
        self.rows.len() / self.names.len().max(1)
    }

    pub(super) fn row(&self, row: usize) -> &[i64] {
        &self.rows[row * self.names.len()..][..self.names.len()]
    }

    /// `i = 1 to 5, j = 1 to 3`
    pub(super) fn extent(&self) -> String {
        let width = self.names.len().max(1);
        let of = |k: usize| self.rows.iter().copied().skip(k).step_by(width);
        let ranges =
            self.names.iter().enumerate().map(|(k, name)| match (of(k).min(), of(k).max()) {
                (Some(least), Some(most)) => format!("{name} = {least} to {most}"),
                _ => format!("no {name}"),
            });
        ranges.collect::<Vec<_>>().join(", ")
    }

    /// `i = 7, j = 2`
    pub(super) fn at(&self, row: usize) -> String {
        at(&self.names, self.row(row))
    }
}

pub(super) fn at(names: &[String], row: &[i64]) -> String {
    let values = names.iter().zip(row).map(|(name, value)| format!("{name} = {value}"));
    values.collect::<Vec<_>>().join(", ")
}

/// An end of a range.
enum Bound {
    Number(f64),
    Expression(String),
}

impl Expander {
    /// Names and values of the indices. `None` when something is wrong with them; what the schema
    /// finds is left to the check.
    pub(super) fn indices(&mut self, path: &str, pattern: &mut Table) -> Option<Indices> {
        let path_over = join(path, "over");
        let over = table_at(pattern, &["over"])?;
        let mut names: Vec<String> = Vec::new();
        let mut rows: Vec<Vec<i64>> = vec![Vec::new()];
        if over.is_empty() || over.len() > limits::INDICES {
            let message = format!("`{path_over}` has {} indices", over.len());
            let help =
                format!("one to {}, such as `over.i = {{ from = 1, to = 50 }}`", limits::INDICES);
            self.refuse(Code::OutOfRange, &path_over, message, help);
            return None;
        }
        let all: Vec<String> = over.keys().cloned().collect();
        let mut fine = true;
        for (name, entry) in over {
            let at = join(&path_over, name);
            let taken = self.parameters.contains(name);
            let constant = is_number(name);
            if taken || constant || !is_name(name) || objection(name).is_some() {
                let message = if taken || constant {
                    let of = if taken { "a parameter" } else { "a number" };
                    format!("the index `{name}` of `{path}` has the name of {of}")
                } else {
                    format!("`{name}` cannot be the name of an index")
                };
                let help = "take a letter, such as i, or letters, digits and `_`";
                self.refuse(Code::BadName, &at, message, help);
                fine = false;
                continue;
            }
            let Value::Table(range) = &mut entry.node.value else { return None };
            let mut bounds = Vec::new();
            for field in ["from", "to"] {
                let bound = &mut range.get_mut(field)?.node.value;
                let stated = match bound {
                    Value::Number(x) => Bound::Number(*x),
                    Value::Text(text) => Bound::Expression(text.strip_prefix('=')?.to_owned()),
                    _ => return None,
                };
                *bound = Value::Number(1.0); // the check need not know expressions of indices
                bounds.push(stated);
            }
            if fine {
                rows = self.further(&at, (&names, &all), rows, &bounds)?;
            }
            names.push(name.clone());
        }
        if rows.len() > limits::REPETITIONS {
            return None;
        }
        fine.then(|| Indices { path: path.to_owned(), names, rows: rows.concat() })
    }

    /// The rows with one more index, of which and of `all` indices there are `names` so far.
    fn further(
        &mut self,
        path: &str,
        (names, all): (&[String], &[String]),
        rows: Vec<Vec<i64>>,
        bounds: &[Bound],
    ) -> Option<Vec<Vec<i64>>> {
        let mut out = Vec::new();
        for row in rows {
            let mut ends = [0i64; 2];
            for ((end, bound), field) in ends.iter_mut().zip(bounds).zip(["from", "to"]) {
                *end = self.bound(&join(path, field), bound, (names, all), &row)?;
            }
            let [from, to] = ends;
            let at = if row.is_empty() { String::new() } else { format!(" ({})", at(names, &row)) };
            if to < from - 1 {
                let message =
                    format!("`{path}` goes from {from} to {to}{at}; expected `to` from `from` on");
                let help = "`to` one below `from` repeats nothing";
                self.refuse(Code::OutOfRange, &join(path, "to"), message, help);
                return None;
            }
            if out.len() + (to - from + 1) as usize > limits::REPETITIONS {
                let most = limits::REPETITIONS;
                let message = format!(
                    "`{path}` goes from {from} to {to}{at}: the pattern is repeated more than {most} times"
                );
                self.refuse(
                    Code::TooLarge,
                    &join(path, "to"),
                    message,
                    "look for a slip in the range",
                );
                return None;
            }
            out.extend(
                (from..=to).map(|index| row.iter().copied().chain([index]).collect::<Vec<_>>()),
            );
        }
        Some(out)
    }

    fn bound(
        &mut self,
        path: &str,
        bound: &Bound,
        (names, all): (&[String], &[String]),
        row: &[i64],
    ) -> Option<i64> {
        let value = match bound {
            Bound::Number(x) => Ok(*x),
            Bound::Expression(text) => {
                let (parameters, broken) = (&self.parameters, &self.broken);
                let values = Row { parameters, broken, names, values: row };
                evaluate(text, &mut |name| values.value(name))
            }
        };
        match value {
            _ if self.broken.get() => None,
            Ok(x) if x.fract() == 0.0 && x.abs() <= limits::INDEX => Some(x as i64),
            Ok(x) => {
                let at =
                    if row.is_empty() { String::new() } else { format!(" ({})", at(names, row)) };
                let x = shown(x);
                let message = format!("`{path}` is {x}{at}; expected a whole number up to 1e9");
                self.refuse(Code::OutOfRange, path, message, "");
                None
            }
            Err(Fault::Unknown(name)) if all.contains(&name) => {
                let message =
                    format!("`{path}` uses the index `{name}`, which has no value there yet");
                let help = "a range may use the indices that stand before its own";
                self.refuse(Code::UnknownName, path, message, help);
                None
            }
            Err(fault) => {
                self.report(path, Code::Expression, fault, names, row);
                None
            }
        }
    }
}
