//! Which class each shape is of: from a file, from its name or from its folder.

use std::collections::BTreeMap;

use salient_sdk::NodeError;

use super::Params;

/// Classes by the names of shapes.
pub(super) enum Labels {
    /// Of a file or of folders.
    Known(BTreeMap<String, String>),
    /// By a pattern of names.
    Pattern(Vec<Part>),
}

impl Labels {
    /// Of the file's text, if there is a file; else by the pattern, if there is one; else of the folders.
    pub fn new(file: Option<(&str, &str)>, params: &Params) -> Result<Self, NodeError> {
        if let Some((text, extension)) = file {
            let read = if extension == "cla" { princeton(text) } else { table(text) };
            return read.map(Self::Known).map_err(|message| NodeError::new(format!("labels: {message}")));
        }
        if let Some(pattern) = &params.pattern {
            return parse(pattern).map(Self::Pattern).map_err(NodeError::new);
        }
        if params.folders.is_empty() {
            return Err(NodeError::new("nothing says which class each shape is of").help(
                "give `labels: \"FILE.csv\"` (id,class), a `pattern` of names, or `folders: folders(\"shape\")`",
            ));
        }
        Ok(Self::Known(params.folders.iter().cloned().collect()))
    }

    /// The class of a shape.
    pub fn class(&self, name: &str) -> Option<String> {
        match self {
            Self::Known(known) => known.get(name).or_else(|| known.get(name.rsplit('/').next()?)).cloned(),
            Self::Pattern(parts) => matched(parts, name),
        }
    }
}

/// `id,class` a line; a first line that says so is a header. Ids may have a file's extension and folder. Semicolons, tabs and, where there is none of
/// these, blanks separate as well.
fn table(text: &str) -> Result<BTreeMap<String, String>, String> {
    let mut known = Ids::default();
    for (number, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let separator = [',', ';', '\t'].into_iter().find(|c| line.contains(*c));
        let cells: Vec<&str> = match separator {
            Some(separator) => line.split(separator).map(|cell| cell.trim().trim_matches('"').trim()).collect(),
            None => line.split_whitespace().collect(),
        };
        let heading = number == 0
            && cells.get(1).is_some_and(|c| ["class", "label", "category"].contains(&c.to_lowercase().as_str()));
        if line.trim().is_empty() || heading {
            continue;
        }
        let [id, class, ..] = cells[..] else {
            return Err(format!("line {} is not `id,class`: `{}`", number + 1, line.trim()));
        };
        if id.is_empty() || class.is_empty() {
            return Err(format!("line {} has an empty id or class: `{}`", number + 1, line.trim()));
        }
        known.insert(id, class)?;
    }
    Ok(known.finish())
}

/// The classification files of the Princeton benchmark: `PSB 1`, counts, then for each class a line `name parent count` and its ids.
fn princeton(text: &str) -> Result<BTreeMap<String, String>, String> {
    let mut words = text.split_whitespace();
    if words.next() != Some("PSB") {
        return Err("a .cla file begins with `PSB`".into());
    }
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty()).skip(2);
    let mut known = Ids::default();
    while let Some(head) = lines.next() {
        let [name, _parent, count] = head.split_whitespace().collect::<Vec<_>>()[..] else {
            return Err(format!("`{head}` is not a class, its parent and a count"));
        };
        let count: usize = count.parse().map_err(|_| format!("`{count}` is not a count of models"))?;
        for _ in 0..count {
            let id = lines.next().ok_or_else(|| format!("the class {name} has fewer than {count} models"))?;
            known.insert(id, name)?;
        }
    }
    Ok(known.finish())
}

/// Classes by the ids of a file. A shape is named after its file's stem, or `folder/stem` where stems are equal; a file may say
/// `folder/stem.off`, and of that any part.
#[derive(Default)]
struct Ids {
    written: BTreeMap<String, String>,
    /// By shorter forms of what is written; `None` where they are of several classes.
    implied: BTreeMap<String, Option<String>>,
}

impl Ids {
    fn insert(&mut self, id: &str, class: &str) -> Result<(), String> {
        if let Some(other) = self.written.insert(id.to_owned(), class.to_owned()).filter(|other| other != class) {
            return Err(format!("`{id}` is of the class {other} and of {class}"));
        }
        let id = id.replace('\\', "/");
        let (folders, file) = id.rsplit_once('/').unwrap_or(("", &id));
        let stem = file.rsplit_once('.').map_or(file, |(stem, _)| stem);
        let folder = folders.rsplit('/').next().unwrap_or_default();
        for form in [stem.to_owned(), format!("{folder}/{stem}")] {
            let known = self.implied.entry(form).or_insert_with(|| Some(class.to_owned()));
            if known.as_deref() != Some(class) {
                *known = None;
            }
        }
        Ok(())
    }

    fn finish(self) -> BTreeMap<String, String> {
        let implied = self.implied.into_iter().filter_map(|(id, class)| Some((id, class?)));
        // What is written counts more than what it implies.
        implied.chain(self.written).collect()
    }
}

/// A piece of a pattern of names.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Part {
    /// This text.
    Text(String),
    /// `*`: any text.
    Any,
    /// `#`: digits, at least one.
    Digits,
    /// `{class}`: the class, at least one character, as few as possible.
    Class,
}

const CLASS: &str = "{class}";

/// What a pattern of names means.
pub(super) fn parse(pattern: &str) -> Result<Vec<Part>, String> {
    let mut parts = Vec::new();
    let mut rest = pattern;
    while let Some(first) = rest.chars().next() {
        let (part, length) = match first {
            '*' => (Part::Any, 1),
            '#' => (Part::Digits, 1),
            '{' if rest.starts_with(CLASS) => (Part::Class, CLASS.len()),
            _ => {
                let end = rest.find(['*', '#', '{']).filter(|at| *at > 0).unwrap_or(first.len_utf8());
                let end = if rest.contains(['*', '#', '{']) { end } else { rest.len() };
                (Part::Text(rest[..end].to_owned()), end)
            }
        };
        parts.push(part);
        rest = &rest[length..];
    }
    if parts.iter().filter(|part| **part == Part::Class).count() == 1 {
        return Ok(parts);
    }
    Err(format!("the pattern `{pattern}` needs one `{CLASS}`, such as `{CLASS}_*` or `{CLASS}#`"))
}

/// If a name fits, the class in it; empty if the class is not among the parts.
fn matched(parts: &[Part], name: &str) -> Option<String> {
    let Some((part, rest)) = parts.split_first() else { return name.is_empty().then(String::new) };
    let ends = || name.char_indices().map(|(at, c)| at + c.len_utf8());
    match part {
        Part::Text(text) => matched(rest, name.strip_prefix(text.as_str())?),
        Part::Any => std::iter::once(0).chain(ends()).find_map(|end| matched(rest, &name[end..])),
        Part::Digits => {
            let digits = name.bytes().take_while(u8::is_ascii_digit).count();
            (1..=digits).rev().find_map(|end| matched(rest, &name[end..]))
        }
        Part::Class => ends().find_map(|end| matched(rest, &name[end..]).map(|_| name[..end].to_owned())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn class(pattern: &str, name: &str) -> Option<String> {
        Labels::Pattern(parse(pattern).unwrap()).class(name)
    }

    #[test]
    fn patterns_find_the_class() {
        assert_eq!(class("{class}_*", "four_legged_07").as_deref(), Some("four"));
        assert_eq!(class("{class}_#", "four_legged_07").as_deref(), Some("four_legged"));
        assert_eq!(class("{class}#", "cat12").as_deref(), Some("cat"));
        assert_eq!(class("*/{class}-*", "set/ant-3").as_deref(), Some("ant"));
        assert_eq!(class("{class}#", "cat"), None);
        assert_eq!(class("{class}{x}#", "a{x}3").as_deref(), Some("a"));
        assert!(parse("*_#").is_err() && parse("{class}{class}").is_err() && parse("").is_err());
    }

    #[test]
    fn tables_and_princeton_files_are_read() {
        let known = table("id,class\n1.off, ant\n2,\"cup\"\n\nsub/3.off,cup\n").unwrap();
        let labels = Labels::Known(known);
        let of = |name: &str| labels.class(name);
        assert_eq!(
            (of("1"), of("2"), of("3"), of("4")),
            (Some("ant".into()), Some("cup".into()), Some("cup".into()), None)
        );
        assert_eq!(of("folder/1").as_deref(), Some("ant"));
        assert_eq!(table("a,b\na,c").unwrap_err(), "`a` is of the class b and of c");
        for text in
            ["1;ant\n2;sea cup", "1\tant\n2\tsea cup", "\u{feff}name;Category\r\n1.off;ant\r\n2.off; sea cup\r\n"]
        {
            let known = table(text).unwrap();
            assert_eq!((known["1"].as_str(), known["2"].as_str()), ("ant", "sea cup"), "{text:?}");
        }
        assert_eq!(table("1.off ant\n2.off cup").unwrap()["2"], "cup");
        // Files of one name in several folders.
        let labels = Labels::Known(table("db\\cat\\1.off,cat\ndb/dog/1.off,dog").unwrap());
        let of = |name: &str| labels.class(name);
        assert_eq!((of("cat/1").as_deref(), of("dog/1").as_deref(), of("1")), (Some("cat"), Some("dog"), None));
        assert!(table("a").is_err() && table("a,").is_err());
        let psb = "PSB 1\n2 3\n\nant 0 2\n10\n11\n\ncup 0 1\n12\n";
        assert_eq!(princeton(psb).unwrap().get("12").map(String::as_str), Some("cup"));
        assert!(princeton("PSB 1\n1 2\nant 0 2\n10").is_err() && princeton("x").is_err());
    }
}
