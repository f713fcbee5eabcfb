//! The reference page of the model file, from the schema that the reader follows.

use super::schema::Dimension;
use super::shape::{Field, Record, Shape, Tagged, alternatives, model_file};

/// How the generated part begins.
const REFERENCE: &str = "
## Reference

This part is generated from the schema that the reader follows (`holonom schema` prints it as JSON
Schema). Numbers may be written as expressions, `\"=parameter\"` or `\"=2*parameter\"`, all but whole
numbers. Fields that are neither required nor have a
default may be left out; what that means is said with them. Of a field and the one that stands
\"instead of\" it, exactly one is given, unless a default is named. Every item of a collection also takes
`title`, a text for people (what it is, where its numbers come from), and `enabled`; `enabled = false`
removes it.

### The file
";

/// `docs/model-file.md`: conventions and examples, then every field of the format.
pub fn reference_markdown() -> String {
    let mut page = Page { out: include_str!("introduction.md").to_owned(), pending: Vec::new() };
    page.out += REFERENCE;
    page.table(model_file());
    while let Some(next) = page.pending.iter().position(|(_, done)| !done) {
        page.pending[next].1 = true;
        match page.pending[next].0 {
            Shape::Record(record) => {
                page.heading("###", &record.title, &record.doc);
                page.table(record);
            }
            Shape::Tagged(tagged) => page.tagged(tagged),
            _ => {}
        }
    }
    page.values();
    page.out
}

struct Page<'a> {
    out: String,
    /// Sections that fields referred to, and whether they are written.
    pending: Vec<(&'a Shape, bool)>,
}

impl<'a> Page<'a> {
    fn heading(&mut self, level: &str, title: &str, doc: &str) {
        self.out += &["\n", level, " ", title, "\n\n", doc, "\n"].concat();
    }

    fn tagged(&mut self, tagged: &'a Tagged) {
        self.heading("###", &tagged.title, &tagged.doc);
        for variant in &tagged.variants {
            let title = format!("`type = \"{}\"`{}", variant.name, only(variant.dimension));
            self.heading("####", &title, &variant.record.doc);
            self.table(&variant.record);
        }
    }

    fn table(&mut self, record: &'a Record) {
        self.out +=
            "\n| field | value | unit | default | meaning |\n| --- | --- | --- | --- | --- |\n";
        let is_item = record.field("enabled").is_some();
        for field in &record.fields {
            let Field { name, doc, unit, .. } = field;
            if is_item && (name == "enabled" || name == "title") {
                continue; // every item has them: said once
            }
            let value = self.value(&field.shape, field.dimension);
            let default = match (&field.default, field.required) {
                (Some(value), _) => format!("`{value}`"),
                (None, true) => "required".to_owned(),
                (None, false) => String::new(),
            };
            let unit = unit.as_deref().unwrap_or_default();
            let only = only(field.dimension);
            let doc = doc.replace('|', "\\|");
            let row = format!("| `{name}`{only} | {value} | {unit} | {default} | {doc} |\n");
            self.out += &row;
        }
    }

    /// What a field takes; records of their own become sections.
    fn value(&mut self, shape: &'a Shape, dimension: Option<Dimension>) -> String {
        match shape {
            Shape::Number => "number".to_owned(),
            Shape::Integer { .. } => "whole number".to_owned(),
            Shape::Bool => "`true`, `false`".to_owned(),
            Shape::Text => "text".to_owned(),
            Shape::Choice(words) => {
                let words: Vec<_> = words.iter().map(|(word, _)| format!("`\"{word}\"`")).collect();
                words.join(", ")
            }
            Shape::List { item, min, max } => {
                let item = self.value(item, dimension);
                match max {
                    Some(n) => format!("{n} × {item}"),
                    None if *min > 0 => format!("{min} or more × {item}"),
                    None => format!("list of {item}"),
                }
            }
            Shape::Record(Record { title, .. }) | Shape::Tagged(Tagged { title, .. }) => {
                self.refer(shape, title);
                format!("[{}](#{})", title.to_lowercase(), anchor(title))
            }
            Shape::Map(item) => format!("names → {}", self.value(item, dimension)),
            Shape::Either(either) if !either.title.is_empty() => {
                self.refer(shape, &either.title);
                for alternative in &either.list {
                    self.value(&alternative.1, dimension); // what it refers to has sections too
                }
                format!("[{}](#values)", either.title)
            }
            Shape::Either(_) => {
                let [planar, spatial] = [Dimension::Planar, Dimension::Spatial].map(|d| {
                    let list = alternatives(shape, Some(d));
                    list.into_iter()
                        .map(|s| self.value(s, Some(d)))
                        .collect::<Vec<_>>()
                        .join(" or ")
                });
                match dimension {
                    _ if planar == spatial => planar,
                    None => format!("planar: {planar}; spatial: {spatial}"),
                    Some(Dimension::Planar) => planar,
                    Some(Dimension::Spatial) => spatial,
                }
            }
        }
    }

    /// Kinds of values with a name.
    fn values(&mut self) {
        self.heading("###", "Values", "Kinds of values that the tables above name:\n");
        for (shape, _) in &self.pending {
            if let Shape::Either(either) = shape {
                self.out += &["- *", &either.title, "*: ", &either.doc, "\n"].concat();
            }
        }
    }

    fn refer(&mut self, shape: &'a Shape, title: &str) {
        let of = |shape: &Shape| match shape {
            Shape::Record(record) => record.title.clone(),
            Shape::Tagged(tagged) => tagged.title.clone(),
            Shape::Either(either) => either.title.clone(),
            _ => String::new(),
        };
        if self.pending.iter().all(|(known, _)| of(known) != title) {
            self.pending.push((shape, false));
        }
    }
}

fn only(dimension: Option<Dimension>) -> &'static str {
    match dimension {
        None => "",
        Some(Dimension::Planar) => " (planar)",
        Some(Dimension::Spatial) => " (spatial)",
    }
}

fn anchor(title: &str) -> String {
    title.to_lowercase().replace(' ', "-")
}
