//! Pieces of RON text with their places: what a graph file is taken apart into.
//!
//! A value stays text until it is known what it should be. Taking it apart once more gives borrowed
//! pieces of the same text, so the offset of a piece is its exact place in the file.

use std::fmt;
use std::ops::Range;
use std::path::Path;
use std::rc::Rc;

use ron::extensions::Extensions;
use ron::value::RawValue;
use salient_sdk::params::ron_options;
use serde::Deserialize;
use serde::de::{DeserializeSeed, Deserializer, EnumAccess, MapAccess, SeqAccess, VariantAccess, Visitor};

use crate::diagnostics::{Diagnostics, Span};

/// A name with its place.
#[derive(Clone, Debug)]
pub struct Name {
    pub text: String,
    pub span: Span,
}

/// A piece of RON text, and the folder that its paths are relative to.
#[derive(Clone, Debug)]
pub struct Value {
    pub span: Span,
    pub dir: Rc<Path>,
}

/// A named value: a field of a call, or an entry of a map.
#[derive(Clone, Debug)]
pub struct Field {
    pub name: Name,
    pub value: Value,
}

/// Arguments in parentheses.
enum Args<'a> {
    Named(Vec<(&'a str, &'a str)>),
    Positional(Vec<&'a str>),
}

/// A call `name(..)`; the name of a bare record is empty.
pub enum Call {
    /// `name(field: value, ..)`, also `name()`.
    Named(Name, Vec<Field>),
    /// `name(value, ..)`.
    Positional(Name, Vec<Value>),
}

/// Checks that a text is one piece of RON and returns the place of the value in it.
pub fn check(report: &mut Diagnostics, span: Span) -> Option<Span> {
    let text = report.sources.text(span).to_owned();
    let parsed = ron::Deserializer::from_str_with_options(&text, &ron_options()).and_then(|mut d| {
        let value = <&RawValue>::deserialize(&mut d).map_err(|e| d.span_error(e))?;
        d.end().map_err(|e| d.span_error(e))?;
        Ok((value.trim().get_ron(), d.extensions()))
    });
    match parsed {
        Ok((value, extensions)) if extensions == Extensions::IMPLICIT_SOME => Some(span.part(&place(&text, value))),
        Ok(_) => {
            let first = text.find("#!").unwrap_or(0);
            let end = text[first..].find(']').map_or(text.len(), |i| first + i + 1);
            report
                .error(span.part(&(first..end)), "syntax", "graph files take no RON extensions")
                .hint("delete this line; `implicit_some` is always on");
            None
        }
        Err(error) => {
            let at = spot(&text, &error.span);
            report.error(span.part(&at), "syntax", plain(&error.code));
            None
        }
    }
}

/// What ron's error means to the writer of the file.
fn plain(error: &ron::Error) -> String {
    match error {
        ron::Error::Eof => "the text ends where a value or a closing bracket should be".into(),
        ron::Error::ExpectedComma => "a comma or a closing bracket is missing here".into(),
        ron::Error::ExpectedStringEnd => "this quotation mark is never closed".into(),
        ron::Error::ExpectedMapColon => "a colon is missing here".into(),
        ron::Error::ExpectedRawValue | ron::Error::ExceededRecursionLimit => "brackets are nested too deep here".into(),
        ron::Error::TrailingCharacters => "nothing may follow the value".into(),
        other => {
            let text = other.to_string();
            let mut chars = text.chars();
            chars.next().map_or(String::new(), |c| c.to_lowercase().chain(chars).collect())
        }
    }
}

/// The bytes of an error's place, at least one character long where there is one.
fn spot(text: &str, span: &ron::error::Span) -> Range<usize> {
    let offset = |at: ron::error::Position| {
        let line: usize = text.split_inclusive('\n').take(at.line.saturating_sub(1)).map(str::len).sum();
        let rest = text.get(line..).unwrap_or_default();
        let column = rest.char_indices().nth(at.col.saturating_sub(1));
        line + column.map_or(rest.len(), |(i, _)| i)
    };
    let (start, end) = (offset(span.start), offset(span.end));
    let next = |at: usize| at + text.get(at..).and_then(|t| t.chars().next()).map_or(0, char::len_utf8);
    if start < end { start..end } else { end..next(end) }
}

/// The place of a piece within the text that it was borrowed from.
fn place(text: &str, piece: &str) -> Range<usize> {
    let start = (piece.as_ptr() as usize).saturating_sub(text.as_ptr() as usize).min(text.len());
    start..(start + piece.len()).min(text.len())
}

impl Value {
    /// A piece of the same text.
    fn piece(&self, text: &str, piece: &str) -> Self {
        Self { span: self.span.part(&place(text, piece)), dir: self.dir.clone() }
    }

    fn name(&self, text: &str, piece: &str) -> Name {
        Name { text: piece.to_owned(), span: self.span.part(&place(text, piece)) }
    }

    /// The text that it stands for, if it is a string.
    pub fn string(&self, report: &Diagnostics) -> Option<Name> {
        let text = string(report.sources.text(self.span))?;
        Some(Name { text, span: self.span })
    }

    /// Its parts, if it is a call or a record.
    pub fn call(&self, report: &Diagnostics) -> Option<Call> {
        let text = report.sources.text(self.span);
        let (name, args) = if text.starts_with('(') { (&text[..0], record(text)?) } else { call(text)? };
        let at = self.name(text, name);
        Some(match args {
            Args::Named(fields) => {
                let field = |(name, value): &(&str, &str)| Field {
                    name: self.name(text, name),
                    value: self.piece(text, value),
                };
                Call::Named(at, fields.iter().map(field).collect())
            }
            Args::Positional(values) => Call::Positional(at, values.iter().map(|v| self.piece(text, v)).collect()),
        })
    }

    /// Its elements, if it is a list.
    pub fn list(&self, report: &Diagnostics) -> Option<Vec<Self>> {
        let text = report.sources.text(self.span);
        let items = text.starts_with('[').then(|| run(text, |d| d.deserialize_seq(Items)))??;
        Some(items.into_iter().map(|item| self.piece(text, item)).collect())
    }

    /// Its entries, keyed by strings, if it is a map. A key that is no string is an error.
    pub fn map(&self, report: &mut Diagnostics) -> Option<Vec<Field>> {
        let text = report.sources.text(self.span).to_owned();
        let entries = text.starts_with('{').then(|| run(&text, |d| d.deserialize_map(Entries)))??;
        let mut fields = Vec::with_capacity(entries.len());
        for (key, value) in entries {
            let key = self.piece(&text, key);
            let name = key.string(report).unwrap_or_else(|| {
                let text = report.sources.text(key.span).to_owned();
                report
                    .error(key.span, "syntax", "a name here is written in quotation marks")
                    .hint(format!("write \"{text}\""));
                Name { text, span: key.span }
            });
            fields.push(Field { name, value: self.piece(&text, value) });
        }
        Some(fields)
    }

    /// The single string argument of `word("..")`.
    pub fn word(&self, report: &Diagnostics, word: &str) -> Option<Result<Name, Span>> {
        match self.call(report)? {
            Call::Positional(name, args) if name.text == word => match args.as_slice() {
                [one] => Some(one.string(report).ok_or(self.span)),
                _ => Some(Err(self.span)),
            },
            Call::Named(name, _) if name.text == word => Some(Err(self.span)),
            _ => None,
        }
    }
}

/// A string's text.
pub fn string(text: &str) -> Option<String> {
    if !text.starts_with(['"', 'r']) {
        return None;
    }
    ron::Options::default().from_str(text).ok()
}

fn run<'a, T>(text: &'a str, parse: impl FnOnce(&mut ron::Deserializer<'a>) -> Result<T, ron::Error>) -> Option<T> {
    let mut d = ron::Deserializer::from_str_with_options(text, &ron_options()).ok()?;
    let value = parse(&mut d).ok()?;
    d.end().ok()?;
    Some(value)
}

fn record(text: &str) -> Option<Args<'_>> {
    run(text, |d| d.deserialize_struct("", &[], Fields))
        .map(Args::Named)
        .or_else(|| run(text, |d| d.deserialize_tuple(0, Items)).map(Args::Positional))
}

fn call(text: &str) -> Option<(&str, Args<'_>)> {
    run(text, |d| d.deserialize_enum("", &[], Head { named: true }))
        .or_else(|| run(text, |d| d.deserialize_enum("", &[], Head { named: false })))
}

/// A raw value without the white space and comments around it.
fn raw<'de, A: MapAccess<'de>>(map: &mut A) -> Result<&'de str, A::Error> {
    Ok(map.next_value::<&'de RawValue>()?.trim().get_ron())
}

struct Fields;

impl<'de> Visitor<'de> for Fields {
    type Value = Vec<(&'de str, &'de str)>;
    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("fields")
    }
    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let mut fields = Vec::new();
        while let Some(name) = map.next_key_seed(Ident)? {
            fields.push((name, raw(&mut map)?));
        }
        Ok(fields)
    }
}

struct Entries;

impl<'de> Visitor<'de> for Entries {
    type Value = Vec<(&'de str, &'de str)>;
    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a map")
    }
    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let mut entries = Vec::new();
        while let Some(key) = map.next_key::<&'de RawValue>()? {
            entries.push((key.trim().get_ron(), raw(&mut map)?));
        }
        Ok(entries)
    }
}

struct Items;

impl<'de> Visitor<'de> for Items {
    type Value = Vec<&'de str>;
    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a list")
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Self::Value, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = seq.next_element::<&'de RawValue>()? {
            items.push(item.trim().get_ron());
        }
        Ok(items)
    }
}

struct Head {
    named: bool,
}

impl<'de> Visitor<'de> for Head {
    type Value = (&'de str, Args<'de>);
    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a call")
    }
    fn visit_enum<A: EnumAccess<'de>>(self, data: A) -> Result<Self::Value, A::Error> {
        let (name, rest) = data.variant_seed(Ident)?;
        let args = if self.named {
            Args::Named(rest.struct_variant(&[], Fields)?)
        } else {
            Args::Positional(rest.tuple_variant(0, Items)?)
        };
        Ok((name, args))
    }
}

/// An identifier, borrowed from the text.
struct Ident;

impl<'de> DeserializeSeed<'de> for Ident {
    type Value = &'de str;
    fn deserialize<D: Deserializer<'de>>(self, d: D) -> Result<&'de str, D::Error> {
        d.deserialize_identifier(self)
    }
}

impl<'de> Visitor<'de> for Ident {
    type Value = &'de str;
    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a name")
    }
    fn visit_borrowed_str<E: serde::de::Error>(self, text: &'de str) -> Result<&'de str, E> {
        Ok(text)
    }
    fn visit_str<E: serde::de::Error>(self, _: &str) -> Result<&'de str, E> {
        Err(E::custom("a name that is not part of the text"))
    }
}
