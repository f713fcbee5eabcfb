//! Errors that rooms share: what is wrong with a model, where it is written and what to try.

use std::fmt;

macro_rules! codes {
    ($($(#[doc = $doc:literal])+ $name:ident = $text:literal, $severity:ident;)+) => {
        /// Stable codes of findings in a model; `docs/errors.md` lists them.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Code { $($(#[doc = $doc])+ $name,)+ }

        impl Code {
            /// Every code, in the order of the documentation.
            pub const ALL: &'static [Code] = &[$(Code::$name,)+];

            /// The code as users read it, `model/…`.
            pub fn as_str(self) -> &'static str {
                match self { $(Code::$name => $text,)+ }
            }

            /// What the code means, one sentence.
            pub fn meaning(self) -> &'static str {
                match self { $(Code::$name => concat!($($doc),+).trim_ascii_start(),)+ }
            }

            /// Whether a finding with this code refuses the model.
            pub fn severity(self) -> Severity {
                match self { $(Code::$name => Severity::$severity,)+ }
            }
        }
    };
}

codes! {
    /// The text is not TOML or JSON.
    Syntax = "model/syntax", Error;
    /// The file, a list, a text or a collection is larger than Holonom accepts.
    TooLarge = "model/too-large", Error;
    /// Tables or lists are nested deeper than any model needs.
    TooDeep = "model/too-deep", Error;
    /// A number is infinite, not a number, or beyond 1e100.
    NotFinite = "model/not-finite", Error;
    /// A value of a kind that no field takes: a date or null.
    UnusableValue = "model/unusable-value", Error;
    /// A key is written twice, or two items of the model share a name.
    DuplicateName = "model/duplicate-name", Error;
    /// A name contains characters that paths and channels cannot carry, or is reserved.
    BadName = "model/bad-name", Error;
    /// The file is written for another version of the format.
    Version = "model/version", Error;
    /// A field is not known where it stands.
    UnknownField = "model/unknown-field", Error;
    /// The `type` of an item, or another choice among words, is not known.
    UnknownChoice = "model/unknown-choice", Error;
    /// A field that is needed is not there.
    MissingField = "model/missing-field", Error;
    /// Fields that exclude each other are given together.
    ConflictingFields = "model/conflicting-fields", Error;
    /// A value has the wrong type: text for a number, a number for a table.
    WrongType = "model/wrong-type", Error;
    /// A list has the wrong number of entries.
    WrongSize = "model/wrong-size", Error;
    /// A spatial item or field stands in a planar model, or the other way round.
    WrongDimension = "model/wrong-dimension", Error;
    /// A body, marker, joint, table, road, parameter, force or channel of this name does not exist.
    UnknownName = "model/unknown-name", Error;
    /// An expression after `=` or in braces cannot be read, or has no value that fits.
    Expression = "model/expression", Error;
    /// A path given for a new value leads nowhere in the model.
    UnknownPath = "model/unknown-path", Error;
    /// A number lies outside the range that the field allows.
    OutOfRange = "model/out-of-range", Error;
    /// An inertia tensor belongs to no distribution of mass.
    Inertia = "model/inertia", Error;
    /// A stiffness or damping matrix is not symmetric or not positive semidefinite.
    Matrix = "model/matrix", Error;
    /// An axis has length zero.
    ZeroAxis = "model/zero-axis", Error;
    /// Axes that must be perpendicular are not.
    NotPerpendicular = "model/not-perpendicular", Error;
    /// Euler parameters do not have unit length.
    NotUnit = "model/not-unit", Error;
    /// An item connects a body with itself.
    SameBody = "model/same-body", Error;
    /// Two points that define a line coincide.
    CoincidentPoints = "model/coincident-points", Error;
    /// A table cannot be interpolated.
    Table = "model/table", Error;
    /// The file that `extends` names cannot be read.
    Extends = "model/extends", Error;
    /// Files extend each other in a circle, or too many in a row.
    ExtendsCircle = "model/extends-circle", Error;
    /// A mesh cannot be read, or does not enclose the body whose mass is asked for.
    Mesh = "model/mesh", Error;
    /// A parameter that no field uses.
    UnusedParameter = "model/unused-parameter", Warning;
    /// A value that is legal but looks like millimetres, degrees or grams.
    Implausible = "model/implausible", Warning;
    /// A table of times does not cover the run that the file asks for.
    ShortTable = "model/short-table", Warning;
    /// A choice that the file leaves open and that changes results.
    NotStated = "model/not-stated", Warning;
}

impl Code {
    /// What to try where a finding says nothing better.
    pub fn usual_help(self) -> &'static str {
        match self {
            Self::Syntax => "the format is described in docs/model-file.md",
            Self::TooLarge => "split what is too large, or keep long records in files of their own",
            Self::TooDeep => "a model needs about six levels; a bracket may be missing",
            Self::NotFinite => "look for a slip in the exponent, or leave the field out",
            Self::UnusableValue => "write a number, a text in quotes, a list or a table",
            Self::DuplicateName => "give each item and each field once, under one name",
            Self::BadName => "choose another name, of letters, digits, `_` and `-`",
            Self::Version => "write `holonom = 1` at the top of the file",
            Self::UnknownField => "`holonom schema --reference` lists the fields",
            Self::UnknownChoice => "choose one of the words that are named",
            Self::MissingField => {
                "state the field, or see `holonom schema --reference` for what it means"
            }
            Self::ConflictingFields => "leave one of them out",
            Self::WrongType => "write a value of the kind that is expected",
            Self::WrongSize => "state exactly as many entries as are expected",
            Self::WrongDimension => "leave it out, or change `dimension`",
            Self::UnknownName => "name an item that the model has",
            Self::Expression => "expressions are arithmetic of numbers and parameters, `\"=2*k\"`",
            Self::UnknownPath => {
                "write it like `forces.front.stiffness[2]`, as the item stands in the file"
            }
            Self::OutOfRange => {
                "state a value in the range that is expected; look for a slip in its sign, exponent or unit"
            }
            Self::Inertia => "check units, signs and the reference point, the centre of mass",
            Self::Matrix => "state a symmetric matrix without negative eigenvalues",
            Self::ZeroAxis => "give a vector along the axis, of any length",
            Self::NotPerpendicular => "choose the second axis perpendicular to the first",
            Self::NotUnit => {
                "Euler parameters are cos(φ/2) and sin(φ/2) times the unit axis; no turn is [1, 0, 0, 0]"
            }
            Self::SameBody => "name two different bodies",
            Self::CoincidentPoints => "move one of the points",
            Self::Table => "state two or more finite points with `x` increasing",
            Self::Extends => "name a model beside this one, such as \"../other/model.toml\"",
            Self::ExtendsCircle => "let one of the files stand by itself",
            Self::Mesh => "give a closed surface of triangles as STL, or no density",
            Self::UnusedParameter => "remove it, or use it",
            Self::Implausible => "check the unit of the value",
            Self::ShortTable => "extend the table, or let the run begin and end within it",
            Self::NotStated => "state it, zeros included",
        }
    }
}

/// Whether a finding refuses the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    /// The model is refused.
    Error,
    /// The model is legal, but look twice.
    Warning,
}

/// A place in a text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Location {
    /// Name of the file as the caller gave it.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// The line, or the part of a long line around the marked place.
    pub excerpt: String,
    /// First marked character of the excerpt, from 0, and the number of marked characters.
    pub mark: (usize, usize),
}

/// Characters of a source line shown around the marked place.
const SHOWN: usize = 96;

/// The last place not after `at` where a character of `text` starts or ends.
fn boundary(text: &str, at: usize) -> usize {
    (0..=at.min(text.len())).rev().find(|&at| text.is_char_boundary(at)).unwrap_or(0)
}

impl Location {
    /// The place of bytes `start..end` in `source`; offsets are clamped to the text.
    pub fn of(file: &str, source: &str, start: usize, end: usize) -> Self {
        let line = source[..boundary(source, start)].matches('\n').count() + 1;
        Self::on_line(line, file, source, start, end)
    }

    /// File, line and column, and the marked line.
    pub fn render(&self) -> String {
        let Self { file, line, column, excerpt, mark: (first, length) } = self;
        let gutter = " ".repeat(line.to_string().len());
        let mark = " ".repeat(*first) + &"^".repeat(*length);
        format!(
            "{gutter}--> {file}:{line}:{column}\n{gutter} |\n{line} | {excerpt}\n{gutter} | {mark}"
        )
    }

    /// The same where the line is known: counting it reads all that stands before.
    pub(crate) fn on_line(line: usize, file: &str, source: &str, start: usize, end: usize) -> Self {
        let start = boundary(source, start);
        let end = boundary(source, end);
        let line_start = source[..start].rfind('\n').map_or(0, |at| at + 1);
        let line_end = source[start..].find('\n').map_or(source.len(), |at| start + at);
        let before = source[line_start..start].chars().count();
        let marked = source[start..end.clamp(start, line_end)].trim_end().chars().count().max(1);
        // A line may be the whole of a large file: only the part shown is copied.
        let skipped = if before <= 2 * SHOWN / 3 { 0 } else { before - SHOWN / 3 };
        let rest: Vec<char> =
            source[line_start..line_end].chars().skip(skipped).take(SHOWN + 1).collect();
        let cut = |c: &char| if c.is_control() { ' ' } else { *c };
        let mut excerpt = String::from(if skipped > 0 { "…" } else { "" });
        excerpt.extend(rest.iter().take(SHOWN).map(cut));
        let excerpt = excerpt.trim_end().to_owned() + if rest.len() > SHOWN { "…" } else { "" };
        let first = before - skipped + usize::from(skipped > 0);
        Self {
            file: file.to_owned(),
            line,
            column: before + 1,
            mark: (first, marked.min(SHOWN.saturating_sub(before - skipped).max(1))),
            excerpt,
        }
    }
}

/// One finding about a model: an error or a warning.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Diagnostic {
    /// Stable code.
    pub code: Code,
    /// Path in the model, `joints.pin.axis[2]`; empty for the file as a whole.
    pub path: String,
    /// What is wrong and what was expected, naming the item.
    pub message: String,
    /// What to try.
    pub help: String,
    /// Where it is written, if it is written in a text.
    pub location: Option<Location>,
}

/// A finding that does not refuse the model.
pub type Warning = Diagnostic;

impl Diagnostic {
    /// A finding without a location yet.
    pub fn new(code: Code, path: impl Into<String>, message: impl Into<String>) -> Self {
        let message = printable(&message.into());
        let help = code.usual_help().to_owned();
        Self { code, path: path.into(), message, help, location: None }
    }

    /// Says what to try, instead of what is usual; an empty text says nothing.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        let help = help.into();
        if !help.is_empty() {
            self.help = printable(&help);
        }
        self
    }

    /// Plain text of several lines with the place in the source marked.
    pub fn render(&self) -> String {
        let word = match self.code.severity() {
            Severity::Error => "error",
            Severity::Warning => "warning",
        };
        let mut lines = vec![format!("{word}[{}]: {}", self.code.as_str(), self.message)];
        if let Some(at) = &self.location {
            lines.push(at.render());
        } else if !self.path.is_empty() {
            lines.push(format!("  at {}", printable(&self.path)));
        }
        if !self.help.is_empty() {
            lines.push(format!("  help: {}", self.help));
        }
        lines.join("\n") + "\n"
    }
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(at) = &self.location {
            write!(f, "{}:{}:{}: ", at.file, at.line, at.column)?;
        }
        write!(f, "{} [{}]", self.message, self.code.as_str())
    }
}

/// Why a model was refused: one or more errors in file order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModelErrors {
    /// The first errors, at least one.
    pub errors: Vec<Diagnostic>,
    /// Number of further errors left out.
    pub omitted: usize,
}

impl ModelErrors {
    /// All errors as plain text with excerpts of the source.
    pub fn render(&self) -> String {
        let total = self.errors.len() + self.omitted;
        let plural = if total == 1 { "" } else { "s" };
        let hidden = match self.omitted {
            0 => String::new(),
            m => format!(", {m} of them not shown"),
        };
        let findings: String = self.errors.iter().map(|e| e.render() + "\n").collect();
        format!("{findings}the model is refused: {total} error{plural}{hidden}\n")
    }
}

/// Longest word that messages show in whole, in characters.
const WORD: usize = 160;

/// Text of a file or a caller as messages show it: control characters escaped, endless words cut in the
/// middle.
pub fn printable(text: &str) -> String {
    if text.len() <= WORD && !text.contains(char::is_control) {
        return text.to_owned();
    }
    let mut out = String::with_capacity(text.len().min(4 * WORD));
    for (k, word) in text.split(' ').enumerate() {
        out += if k > 0 { " " } else { "" };
        let length = word.chars().count();
        let mut add = |c: char| match c {
            c if c.is_control() => out.extend(c.escape_debug()),
            c => out.push(c),
        };
        if length <= WORD {
            word.chars().for_each(add);
            continue;
        }
        word.chars().take(WORD / 2).for_each(&mut add);
        add('…');
        word.chars().skip(length - WORD / 2).for_each(add);
    }
    out
}

/// A number as messages show it: short, and exact enough to be recognised.
pub(crate) fn shown(x: f64) -> String {
    let size = x.abs();
    if x == 0.0 || (1e-4..1e7).contains(&size) { format!("{x}") } else { format!("{x:e}") }
}

/// A number of four digits: what a computation has left.
pub(crate) fn rounded(x: f64) -> String {
    let written = format!("{x:.3e}");
    shown(written.parse().unwrap_or(x))
}

impl From<Diagnostic> for ModelErrors {
    fn from(error: Diagnostic) -> Self {
        Self { errors: vec![error], omitted: 0 }
    }
}

impl fmt::Display for ModelErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (n, error) in self.errors.iter().enumerate() {
            write!(f, "{}{error}", if n == 0 { "" } else { "\n" })?;
        }
        match self.omitted {
            0 => Ok(()),
            m => write!(f, "\nand {m} more"),
        }
    }
}

impl std::error::Error for Diagnostic {}
impl std::error::Error for ModelErrors {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_is_cut_around_the_marked_place() {
        let text = format!("x\n{}{}{}\nz", "a".repeat(300), "XYZ", "b".repeat(300));
        let at = Location::of("f", &text, 302, 305);
        assert_eq!((at.line, at.column), (2, 301));
        let marked: String = at.excerpt.chars().skip(at.mark.0).take(at.mark.1).collect();
        assert_eq!(marked, "XYZ");
        assert!(at.excerpt.chars().count() <= SHOWN + 2);
    }

    #[test]
    fn any_offset_of_any_text_has_a_place() {
        let text = "é = \"ß\"\r\n\tx = 1 # ∂\n";
        for start in 0..text.len() + 3 {
            for end in start..text.len() + 5 {
                let at = Location::of("f", text, start, end);
                assert!(at.line >= 1 && at.line <= 3 && at.mark.1 >= 1);
            }
        }
    }

    #[test]
    fn texts_of_others_are_told_without_control_characters_and_endless_words() {
        assert_eq!(printable("a \u{1b}[31mred\n"), "a \\u{1b}[31mred\\n");
        let long = printable(&format!("the name `{}` is long", "é".repeat(100_000)));
        assert!(
            long.chars().count() < 200 && long.starts_with("the name `é") && long.contains('…')
        );
        let plain = "a sentence of ordinary words ".repeat(20);
        assert_eq!(printable(&plain), plain);
    }

    #[test] // independent truth: no code is without
    fn every_finding_has_a_help_line() {
        for &code in Code::ALL {
            let found = Diagnostic::new(code, "a.b", "something is wrong").help("").render();
            assert!(found.contains("\n  help: "), "{found}");
        }
    }

    #[test] // a code is an interface: no two may share a text
    fn codes_are_distinct_and_explained() {
        let mut texts: Vec<_> = Code::ALL.iter().map(|c| c.as_str()).collect();
        texts.sort_unstable();
        texts.dedup();
        assert_eq!(texts.len(), Code::ALL.len());
        assert!(Code::ALL.iter().all(|c| c.meaning().ends_with('.')));
    }
}

/// Why the equations could not be evaluated at a trial point; the step is then tried again with a
/// smaller one, and the run fails with this if that does not help.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{message}")]
pub struct EvaluationFailure {
    /// Stable code, e.g. `simulation/position-recovery`.
    pub code: &'static str,
    /// What happened, with the item concerned.
    pub message: String,
    /// Row of the constraints concerned.
    pub row: Option<usize>,
    /// Generalized coordinate concerned.
    pub coordinate: Option<usize>,
    /// Group of relative coordinates concerned.
    pub group: Option<usize>,
}

impl EvaluationFailure {
    /// A failure that concerns no item.
    pub fn new(code: &'static str, message: impl Into<String>) -> Self {
        Self { code, message: message.into(), row: None, coordinate: None, group: None }
    }

    /// The same, of a row of the constraints.
    #[must_use]
    pub fn of_row(self, row: Option<usize>) -> Self {
        Self { row, ..self }
    }

    /// The same, of a generalized coordinate.
    #[must_use]
    pub fn of_coordinate(self, coordinate: usize) -> Self {
        Self { coordinate: Some(coordinate), ..self }
    }

    /// The same, of a group of relative coordinates.
    #[must_use]
    pub fn of_group(self, group: usize) -> Self {
        Self { group: Some(group), ..self }
    }
}
