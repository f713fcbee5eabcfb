//! Functions of time and elastic laws, from numbers and tables.

use super::Context;
use crate::error::Code;
use crate::io::names::suggest;
use crate::io::schema::{self, Motion};
use crate::model::ElasticLaw;
use crate::model::{MonotoneCubic, TableError, TimeFunction};

impl Context<'_> {
    /// `scale` times a function of time.
    pub(super) fn motion(
        &mut self,
        path: &str,
        motion: &Motion,
        scale: f64,
    ) -> Option<TimeFunction> {
        let function = match motion {
            Motion::Number(value) => return Some(TimeFunction::Constant(scale * value)),
            Motion::Function(function) => function,
        };
        match function {
            schema::TimeFunction::Constant(f) => Some(TimeFunction::Constant(scale * f.value)),
            schema::TimeFunction::Polynomial(f) => Some(TimeFunction::Polynomial {
                coefficients: f.coefficients.iter().map(|c| scale * c).collect(),
                start: f.start,
            }),
            schema::TimeFunction::Harmonic(f) => Some(TimeFunction::Harmonic {
                amplitude: scale * f.amplitude,
                angular_frequency: f.angular_frequency,
                phase: f.phase,
                offset: scale * f.offset,
            }),
            schema::TimeFunction::SmoothStep(f) => {
                if f.end <= f.start {
                    let path = format!("{path}.end");
                    let message = format!(
                        "`{path}` is {}; expected a time after the start, {}",
                        f.end, f.start
                    );
                    self.refuse(Code::OutOfRange, path, message, "let the change take some time");
                    return None;
                }
                let (from, to) = (scale * f.from, scale * f.to);
                Some(TimeFunction::SmoothStep { from, to, start: f.start, end: f.end })
            }
            schema::TimeFunction::Table(f) => {
                let (at, x, y) =
                    self.columns(path, f.table.as_ref(), f.x.as_ref(), f.y.as_ref())?;
                let function = TimeFunction::table(x, y.iter().map(|y| scale * y).collect(), &at);
                self.table(&at, function)
            }
        }
    }

    /// A law from a stiffness or a table; none where neither is given.
    pub(super) fn law(
        &mut self,
        item: &str,
        stiffness: Option<f64>,
        (field, law): (&str, Option<&schema::Law>),
    ) -> Option<ElasticLaw> {
        let Some(law) = law else { return Some(ElasticLaw::Linear(stiffness.unwrap_or(0.0))) };
        let path = format!("{item}.{field}");
        if stiffness.is_some() {
            let message =
                format!("`{item}` has both `stiffness` and `{field}`; expected one of them");
            self.refuse(Code::ConflictingFields, path, message, "leave one of them out");
            return None;
        }
        let (at, x, y) = self.columns(&path, law.table.as_ref(), law.x.as_ref(), law.y.as_ref())?;
        self.table(&at, MonotoneCubic::new(x, y)).map(|table| ElasticLaw::Table(Box::new(table)))
    }

    /// The columns of a named or inline table, and where they are written.
    fn columns(
        &mut self,
        path: &str,
        table: Option<&String>,
        x: Option<&Vec<f64>>,
        y: Option<&Vec<f64>>,
    ) -> Option<(String, Vec<f64>, Vec<f64>)> {
        match (table, x, y) {
            (Some(name), None, None) => {
                let Some(table) = self.file.tables.get(name) else {
                    let path = format!("{path}.table");
                    let message = format!("`{path}` names the table `{name}`, which is not there");
                    let known = self.file.tables.keys().map(String::as_str);
                    let help = suggest(&self.errors, name, "tables", known);
                    self.refuse(Code::UnknownName, path, message, &help);
                    return None;
                };
                // Errors of a named table are reported once, at the table.
                Some((format!("tables.{name}"), table.x.clone(), table.y.clone()))
            }
            (None, Some(x), Some(y)) => Some((path.to_owned(), x.clone(), y.clone())),
            (None, None, None) => {
                let message = format!("`{path}` has no `table`");
                let at = format!("{path}.table");
                self.refuse(
                    Code::MissingField,
                    at,
                    message,
                    "give `table`, or `x` and `y` in its place",
                );
                None
            }
            (Some(_), _, _) => {
                let message = format!("`{path}` has both `table` and its own columns");
                self.refuse(Code::ConflictingFields, path, message, "leave one of them out");
                None
            }
            (None, _, _) => {
                let missing = if x.is_none() { "x" } else { "y" };
                let message = format!(
                    "`{path}` has no `{missing}`; expected as many entries as in the other column"
                );
                self.refuse(Code::MissingField, format!("{path}.{missing}"), message, "");
                None
            }
        }
    }

    /// Named tables are checked whether they are used or not.
    pub(super) fn tables(&mut self) {
        let file = self.file;
        for (name, table) in &file.tables {
            let function = MonotoneCubic::new(table.x.clone(), table.y.clone());
            if let Err(error) = function {
                self.table_error(&format!("tables.{name}"), &error);
            }
        }
    }

    fn table<T>(&mut self, path: &str, function: Result<T, TableError>) -> Option<T> {
        match function {
            Ok(function) => Some(function),
            Err(error) => {
                if !path.starts_with("tables.") {
                    self.table_error(path, &error);
                }
                None
            }
        }
    }

    fn table_error(&mut self, path: &str, error: &TableError) {
        let (at, help) = match error {
            TableError::Size { .. } => {
                (format!("{path}.x"), "give `x` and `y` the same length, two or more")
            }
            TableError::Order { index, .. } => {
                (format!("{path}.x[{index}]"), "sort the table by `x` and remove repeated points")
            }
            TableError::NotFinite { .. } => (path.to_owned(), ""),
        };
        self.refuse(Code::Table, at, format!("`{path}`: {error}"), help);
    }
}
