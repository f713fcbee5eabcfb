//! Numbers as arithmetic, `"=2*k"`, and names with arithmetic in braces, `link_{i - 1:02}`.

use super::limits;
use super::names::nearest;
use crate::error::shown;

/// Why an expression has no value.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Fault {
    /// No number has this name.
    Unknown(String),
    /// What else is wrong, and what to try (may be empty).
    Other(String, String),
}

fn fault<T>(message: impl Into<String>, help: impl Into<String>) -> Result<T, Fault> {
    Err(Fault::Other(message.into(), help.into()))
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Token<'a> {
    Number(f64),
    Name(&'a str),
    Sign(&'a str),
    End,
}

/// The token at the beginning of `text` after blanks, and the bytes before and after it.
fn token(text: &str) -> Result<(Token<'_>, usize, usize), Fault> {
    let rest = text.trim_start();
    let start = text.len() - rest.len();
    let Some(first) = rest.chars().next() else { return Ok((Token::End, start, start)) };
    let run = |of: &dyn Fn(char) -> bool| rest.find(|c| !of(c)).unwrap_or(rest.len());
    let (token, length) = if first.is_ascii_digit() || first == '.' {
        let mut length = run(&|c| c.is_ascii_digit() || c == '.');
        let exponent = &rest[length..];
        if exponent.starts_with(['e', 'E']) {
            let sign = usize::from(exponent[1..].starts_with(['+', '-']));
            let digits = &exponent[1 + sign..];
            let digits = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
            length += if digits > 0 { 1 + sign + digits } else { 0 };
        }
        match rest[..length].parse() {
            Ok(x) => (Token::Number(x), length),
            Err(_) => return fault(format!("`{}` is no number", &rest[..length]), ""),
        }
    } else if first.is_alphabetic() || first == '_' {
        let length = run(&|c| c.is_alphanumeric() || c == '_');
        (Token::Name(&rest[..length]), length)
    } else if rest.starts_with("**") {
        return fault("`**` is no sign", "powers are written x^n");
    } else if rest.starts_with("//") {
        (Token::Sign("//"), 2)
    } else if "+-*/%^(),".contains(first) {
        (Token::Sign(&rest[..1]), 1)
    } else {
        return fault(format!("{first:?} does not belong there"), SIGNS);
    };
    Ok((token, start, start + length))
}

const SIGNS: &str = "expressions have numbers, names, + - * / // % ^, parentheses and functions";

/// The functions, by their number of arguments.
const OF_ONE: [(&str, fn(f64) -> f64); 13] = [
    ("abs", f64::abs),
    ("sqrt", f64::sqrt),
    ("sin", f64::sin),
    ("cos", f64::cos),
    ("tan", f64::tan),
    ("asin", f64::asin),
    ("acos", f64::acos),
    ("atan", f64::atan),
    ("exp", f64::exp),
    ("log", f64::ln),
    ("floor", f64::floor),
    ("ceil", f64::ceil),
    ("round", f64::round),
];
const OF_TWO: [(&str, fn(f64, f64) -> f64); 3] =
    [("atan2", f64::atan2), ("min", f64::min), ("max", f64::max)];

/// Whether a name can stand in an expression among others: letters, digits and `_`, no digit first.
pub(super) fn is_name(name: &str) -> bool {
    matches!(token(name), Ok((Token::Name(found), ..)) if found == name)
}

/// Whether a name has a value by itself, which it would hide as the name of another: `pi`, `2`, `1e3`, `2-1`.
pub(super) fn is_number(name: &str) -> bool {
    evaluate(name, &mut |_| None).is_ok()
}

/// The value of an expression. A text that is a name as a whole is that name, whatever its characters.
pub(super) fn evaluate(
    text: &str,
    value_of: &mut dyn FnMut(&str) -> Option<f64>,
) -> Result<f64, Fault> {
    if let Some(value) = value_of(text.trim()) {
        return Ok(value);
    }
    let mut reader = Reader { rest: text, token: Token::End, depth: 0, value_of };
    reader.advance()?;
    let value = reader.sum()?;
    match reader.token {
        Token::End => Ok(value),
        other => fault(format!("{} does not belong there", said(other)), SIGNS),
    }
}

fn said(token: Token<'_>) -> String {
    match token {
        Token::Number(x) => format!("the number {x}"),
        Token::Name(text) | Token::Sign(text) => format!("`{text}`"),
        Token::End => "the end".to_owned(),
    }
}

/// Floored division and its remainder, which has the sign of the divisor.
fn divided(a: f64, b: f64) -> (f64, f64) {
    let rest = a % b;
    let rest = if rest != 0.0 && (rest < 0.0) != (b < 0.0) { rest + b } else { rest };
    (((a - rest) / b).round(), rest)
}

struct Reader<'a, 'b> {
    rest: &'a str,
    token: Token<'a>,
    depth: usize,
    value_of: &'b mut dyn FnMut(&str) -> Option<f64>,
}

impl Reader<'_, '_> {
    fn advance(&mut self) -> Result<(), Fault> {
        let (token, _, end) = token(self.rest)?;
        self.rest = &self.rest[end..];
        self.token = token;
        Ok(())
    }

    fn take(&mut self, signs: &[&'static str]) -> Result<Option<&'static str>, Fault> {
        let Token::Sign(sign) = self.token else { return Ok(None) };
        let Some(&found) = signs.iter().find(|s| **s == sign) else { return Ok(None) };
        self.advance()?;
        Ok(Some(found))
    }

    fn sum(&mut self) -> Result<f64, Fault> {
        let mut value = self.product()?;
        while let Some(sign) = self.take(&["+", "-"])? {
            let next = self.product()?;
            value = if sign == "+" { value + next } else { value - next };
        }
        Ok(value)
    }

    fn product(&mut self) -> Result<f64, Fault> {
        let mut value = self.factor()?;
        while let Some(sign) = self.take(&["*", "/", "//", "%"])? {
            let next = self.factor()?;
            value = match sign {
                "*" => value * next,
                "/" => value / next,
                "//" => divided(value, next).0,
                _ => divided(value, next).1,
            };
        }
        Ok(value)
    }

    /// Signs bind weaker than powers: -2^2 is -4.
    fn factor(&mut self) -> Result<f64, Fault> {
        let mut negative = false;
        while let Some(sign) = self.take(&["+", "-"])? {
            negative ^= sign == "-";
        }
        let base = self.atom()?;
        let value = if self.take(&["^"])?.is_some() {
            self.deeper()?;
            let exponent = self.factor()?;
            self.depth -= 1;
            base.powf(exponent)
        } else {
            base
        };
        Ok(if negative { -value } else { value })
    }

    fn deeper(&mut self) -> Result<(), Fault> {
        self.depth += 1;
        if self.depth > limits::NESTING {
            return fault(format!("it is nested more than {} deep", limits::NESTING), "");
        }
        Ok(())
    }

    fn atom(&mut self) -> Result<f64, Fault> {
        let token = self.token;
        match token {
            Token::Number(x) => {
                self.advance()?;
                Ok(x)
            }
            Token::Name(name) => {
                self.advance()?;
                if self.take(&["("])?.is_some() {
                    return self.call(name);
                }
                match (self.value_of)(name) {
                    Some(value) => Ok(value),
                    None if name == "pi" => Ok(std::f64::consts::PI),
                    None => Err(Fault::Unknown(name.to_owned())),
                }
            }
            Token::Sign("(") => {
                self.advance()?;
                self.deeper()?;
                let value = self.sum()?;
                self.depth -= 1;
                self.close()?;
                Ok(value)
            }
            other => fault(format!("{} stands where a number is expected", said(other)), SIGNS),
        }
    }

    fn close(&mut self) -> Result<(), Fault> {
        match self.take(&[")"])? {
            Some(_) => Ok(()),
            None => fault(format!("{} stands where `)` is expected", said(self.token)), ""),
        }
    }

    fn call(&mut self, name: &str) -> Result<f64, Fault> {
        self.deeper()?;
        let mut arguments = Vec::new();
        if self.token != Token::Sign(")") {
            arguments.push(self.sum()?);
            while self.take(&[","])?.is_some() {
                arguments.push(self.sum()?);
            }
        }
        self.depth -= 1;
        self.close()?;
        let one = OF_ONE.iter().find(|(known, _)| *known == name);
        let two = OF_TWO.iter().find(|(known, _)| *known == name);
        match (one, two, &arguments[..]) {
            (Some((_, function)), _, [x]) => Ok(function(*x)),
            (_, Some((_, function)), [x, y]) => Ok(function(*x, *y)),
            (Some(_), ..) => fault(format!("`{name}` takes one number"), ""),
            (_, Some(_), _) => fault(format!("`{name}` takes two numbers"), ""),
            _ => {
                let known = OF_ONE.iter().map(|f| f.0).chain(OF_TWO.iter().map(|f| f.0));
                let help = match nearest(name, known.clone()) {
                    Some(meant) => format!("did you mean `{meant}`?"),
                    None => format!("functions: {}", known.collect::<Vec<_>>().join(", ")),
                };
                fault(format!("`{name}` is no function"), help)
            }
        }
    }
}

/// Calls `visit` with the names in an expression and their bytes, functions left out; stops where it
/// cannot be read.
pub(super) fn names<'a>(text: &'a str, visit: &mut dyn FnMut(&'a str, usize)) {
    let mut at = 0;
    while let Ok((found, start, end)) = token(&text[at..]) {
        match found {
            Token::End => return,
            Token::Name(name)
                if !matches!(token(&text[at + end..]), Ok((Token::Sign("("), ..))) =>
            {
                visit(name, at + start);
            }
            _ => {}
        }
        at += end;
    }
}

/// An expression with numbers in the place of some names.
pub(super) fn with_numbers(text: &str, number_of: &dyn Fn(&str) -> Option<i64>) -> String {
    let mut out = String::with_capacity(text.len() + 8);
    let mut done = 0;
    names(text, &mut |name, start| {
        if let Some(number) = number_of(name) {
            out += &text[done..start];
            // Digits beside it must not become its own, nor must it become part of a name: k-(2) is no `k-2`.
            let joins = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
            let end = start + name.len();
            let beside = text[..start].ends_with(joins) || text[end..].starts_with(joins);
            let [open, close] = if number < 0 || beside { ["(", ")"] } else { ["", ""] };
            out.extend([open, &number.to_string(), close]);
            done = end;
        }
    });
    out + &text[done..]
}

/// A part of a text with braces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Part<'a> {
    Plain(&'a str),
    /// Expression and number of digits.
    Number(&'a str, usize),
}

/// Whether a name is what a text with braces gives for some numbers: `link_07` for `link_{i:02}`.
pub(super) fn could_be(parts: &[Part<'_>], name: &str) -> bool {
    if name.len() > 4 * limits::NAME_CHARACTERS {
        return false; // no name
    }
    // Where in the name the parts so far can end, in order.
    let mut ends = vec![0];
    for part in parts {
        match part {
            Part::Plain(plain) => {
                ends.retain(|end| name[*end..].starts_with(plain));
                ends.iter_mut().for_each(|end| *end += plain.len());
            }
            Part::Number(..) => {
                let begins = |at: usize| ends.binary_search(&at).is_ok();
                let mut inside = false;
                let digits = name.bytes().enumerate().filter(|(at, byte)| {
                    let signed = *at > 0 && name.as_bytes()[at - 1] == b'-' && begins(at - 1);
                    inside = byte.is_ascii_digit() && (inside || signed || begins(*at));
                    inside
                });
                ends = digits.map(|(at, _)| at + 1).collect();
            }
        }
        if ends.is_empty() {
            return false;
        }
    }
    ends.contains(&name.len())
}

/// The parts of `link_{i - 1:02}`; doubled braces stand for themselves.
pub(super) fn parts(text: &str) -> Result<Vec<Part<'_>>, Fault> {
    let mut out = Vec::new();
    let mut rest = text;
    while let Some(at) = rest.find(['{', '}']) {
        let brace = &rest[at..=at];
        if rest[at + 1..].starts_with(brace) {
            out.push(Part::Plain(&rest[..=at]));
            rest = &rest[at + 2..];
            continue;
        }
        let close = rest[at..].find('}').filter(|_| brace == "{");
        let Some(close) = close.map(|close| at + close) else {
            let other = if brace == "{" { "}" } else { "{" };
            return fault(
                format!("`{brace}` has no `{other}`"),
                "a brace that is part of a text is doubled",
            );
        };
        out.push(Part::Plain(&rest[..at]));
        let inside = &rest[at + 1..close];
        let (expression, format) = inside.split_once(':').unwrap_or((inside, "01"));
        let digits = format.strip_prefix('0').and_then(|n| n.parse().ok());
        let Some(digits) = digits.filter(|n| *n <= 20) else {
            return fault(
                format!("`{{{inside}}}` ends in `:{format}`"),
                "zeros in front: `{i:03}`",
            );
        };
        out.push(Part::Number(expression, digits));
        rest = &rest[close + 1..];
    }
    out.push(Part::Plain(rest));
    Ok(out)
}

/// A text with the values of its braces, which are whole numbers.
pub(super) fn filled(
    text: &str,
    value_of: &mut dyn FnMut(&str) -> Option<f64>,
) -> Result<String, Fault> {
    let mut out = String::with_capacity(text.len() + 8);
    for part in parts(text)? {
        match part {
            Part::Plain(text) => out += text,
            Part::Number(expression, digits) => {
                let x = evaluate(expression, value_of)?;
                if x.fract() != 0.0 || x.abs() > limits::INDEX {
                    let x = shown(x);
                    let message = format!("`{{{expression}}}` is {x}; expected a whole number");
                    return fault(message, "`//` divides and rounds down, as does `floor`");
                }
                let number = format!("{:0digits$}", x as i64);
                out += &number;
            }
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> Result<f64, Fault> {
        evaluate(text, &mut |name| match name {
            "i" => Some(7.0),
            "k" => Some(2.5),
            "a-b" => Some(-1.0),
            _ => None,
        })
    }

    #[test]
    fn arithmetic_is_the_usual_one() {
        for (text, expected) in [
            ("2 + 3*4 - 1", 13.0),
            ("2*k", 5.0),
            ("(i - 0.5)/10", 0.65),
            ("-2^2", -4.0),
            ("2^-1", 0.5),
            ("2^3^2", 512.0),
            ("- -+3", 3.0),
            ("7 // 2", 3.0),
            ("-7 // 2", -4.0),
            ("-7 % 3", 2.0),
            ("7 % -3", -2.0),
            ("8 / 2 / 2", 2.0),
            ("1 - 2 - 3", -4.0),
            ("1.5e-3*.5e3", 0.75),
            ("sqrt(16) + max(1, i) + cos(0)", 12.0),
            ("atan2(0, -1) - pi", 0.0),
            ("a-b", -1.0), // a name as a whole
        ] {
            assert_eq!(value(text), Ok(expected), "{text}");
        }
    }

    #[test]
    fn what_cannot_be_read_is_said() {
        for (text, part) in [
            ("", "the end"),
            ("2*", "the end"),
            ("2 3", "the number 3"),
            ("(2", "`)`"),
            ("2)", "`)`"),
            ("1.2.3", "`1.2.3`"),
            ("2 ** 3", "`**`"),
            ("2 & 3", "'&'"),
            ("sine(2)", "`sine`"),
            ("sin(2, 3)", "one number"),
            ("min(2)", "two numbers"),
            ("min(1, 2, 3)", "two numbers"),
            ("sin()", "one number"),
            ("min()", "two numbers"),
            ("min(1,)", "`)`"),
            ("sin(", "the end"),
            (&"(".repeat(1000), "deep"),
            (&"2^".repeat(1000), "deep"),
        ] {
            let Err(Fault::Other(message, _)) = value(text) else { panic!("{text}") };
            assert!(message.contains(part), "{text}: {message}");
        }
        assert_eq!(value("2*speed"), Err(Fault::Unknown("speed".to_owned())));
        assert_eq!(value(&"-".repeat(10_001)).is_err(), value("-").is_err());
    }

    #[test]
    fn names_are_replaced_where_they_stand() {
        let replaced = with_numbers("(i-i2)*min(i, k) - i", &|name| (name == "i").then_some(-3));
        assert_eq!(replaced, "((-3)-i2)*min((-3), k) - (-3)");
        assert_eq!(with_numbers("i(2)", &|_| Some(1)), "i(2)");
        // Beside `-` it is no part of a name that can stand alone.
        let replaced = with_numbers("a-i + i*2 - i", &|name| (name == "i").then_some(3));
        assert_eq!(replaced, "a-(3) + 3*2 - 3");
        // Not 21: what is refused with a parameter is refused with an index.
        for text in ["2i", "i.5", "1.i"] {
            let replaced = with_numbers(text, &|_| Some(1));
            assert!(value(text).is_err() && value(&replaced).is_err(), "{text}: {replaced}");
        }
    }

    #[test]
    fn a_name_could_be_made_where_some_numbers_make_it() {
        let many = "{i}".repeat(60);
        for (text, name, truth) in [
            ("link_{i:02}", "link_07", true),
            ("link_{i}", "link_-7", true),
            ("link_{i}", "link_", false),
            ("link_{i}", "link_7a", false),
            ("link_{i}", "link_--7", false),
            ("l{i}_{j}", "l1_2", true),
            ("l{i}_{j}", "l1_", false),
            ("{i}{j}", "1-2", true),
            ("{i}{j}", "12", true),
            ("{i}{j}", "1", false),
            ("{i}1{j}", "21112", true),
            ("ä{i}ö", "ä12ö", true),
            ("{{{i}", "{3", true),
            ("plain", "plain", true),
            ("", "", true),
            (&many, &"1".repeat(60), true),
            (&many, &"1".repeat(59), false),
            (&(many.clone() + "x"), &"1".repeat(120), false), // at once: not all ways are tried
        ] {
            assert_eq!(could_be(&parts(text).unwrap(), name), truth, "{text} {name}");
        }
    }

    #[test]
    fn names_that_are_numbers_by_themselves_are_told() {
        for name in ["pi", "2", "1e3", "1e-3", "-1", "2-1", "-pi"] {
            assert!(is_number(name), "{name}");
        }
        for name in ["e", "inf", "nan", "k-2", "2nd", "sin", "pi2", "_1", "1-", ""] {
            assert!(!is_number(name), "{name}");
        }
    }

    #[test]
    fn braces_are_whole_numbers() {
        let fill = |text: &str| filled(text, &mut |name| (name == "i").then_some(7.0));
        for (text, expected) in [
            ("link_{i}", "link_7"),
            ("link_{i-1:02}", "link_06"),
            ("{i//2}_{2*i:03}", "3_014"),
            ("{{i}} {i}", "{i} 7"),
            ("{i - 9}", "-2"),
            ("plain", "plain"),
        ] {
            assert_eq!(fill(text), Ok(expected.to_owned()), "{text}");
        }
        for text in ["{i/2}", "{i", "i}", "{}", "{i:x}", "{i:2}", "{i:099}", "{1/0}", "{2^80}"] {
            assert!(matches!(fill(text), Err(Fault::Other(..))), "{text}");
        }
        assert_eq!(fill("{j}"), Err(Fault::Unknown("j".to_owned())));
    }
}
