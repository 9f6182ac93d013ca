//! Params of nodes: documented by their schema, parsed from RON field by field so that every error
//! is found and has its exact place.

use std::ops::Range;

use ron::extensions::Extensions;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// A param that names an input file, relative to the graph file that says it.
///
/// The engine resolves it, and a cache key holds the file's extension and content, never its path.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct FileParam(pub String);

/// The `format` of a [`FileParam`] in a schema.
const FILE_FORMAT: &str = "file";

impl JsonSchema for FileParam {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "File".into()
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "format": FILE_FORMAT })
    }
}

impl FileParam {
    /// The lower-case extension of the file name, empty if there is none.
    #[must_use]
    pub fn extension(&self) -> String {
        let name = self.0.rsplit(['/', '\\']).next().unwrap_or_default();
        name.rsplit_once('.').map_or(String::new(), |(_, extension)| extension.to_lowercase())
    }
}

/// What is wrong with a param, and where in its text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParamError {
    /// The param's name; empty if none is to blame.
    pub param: String,
    /// Bytes within the text of the param's value.
    pub span: Range<usize>,
    /// What is wrong.
    pub message: String,
}

/// One param, as documented by the schema.
#[derive(Clone, Debug, PartialEq)]
pub struct ParamInfo {
    /// Its name.
    pub name: String,
    /// Unit, range and source, from the field's doc comment.
    pub doc: String,
    /// Its default as JSON; `None` if it must be given.
    pub default: Option<Value>,
    /// Whether it names an input file.
    pub file: bool,
    /// Smallest and largest value, inclusive, where the schema has them.
    pub range: (Option<f64>, Option<f64>),
    /// What is written there: `number`, `integer`, `boolean`, `string`, or the variants of an enum.
    pub form: String,
}

/// The JSON schema of a params type.
#[must_use]
pub fn schema_of<P: JsonSchema>() -> Value {
    schemars::schema_for!(P).to_value()
}

/// The params that a schema documents, by name.
#[must_use]
pub fn infos(schema: &Value) -> Vec<ParamInfo> {
    let required =
        |name: &str| schema["required"].as_array().is_some_and(|r| r.iter().any(|x| x.as_str() == Some(name)));
    let Some(properties) = schema["properties"].as_object() else { return Vec::new() };
    let info = |(name, property): (&String, &Value)| {
        let inner = resolve(schema, property);
        ParamInfo {
            name: name.clone(),
            doc: property["description"].as_str().or(inner["description"].as_str()).unwrap_or_default().to_owned(),
            default: (!required(name)).then(|| property["default"].clone()),
            file: inner["format"] == FILE_FORMAT,
            range: (bound(inner, property, "minimum"), bound(inner, property, "maximum")),
            form: form(schema, property),
        }
    };
    properties.iter().map(info).collect()
}

fn bound(inner: &Value, property: &Value, key: &str) -> Option<f64> {
    property[key].as_f64().or(inner[key].as_f64())
}

/// Follows `$ref` and the non-null alternative of an optional property.
fn resolve<'a>(schema: &'a Value, property: &'a Value) -> &'a Value {
    if let Some(name) = property["$ref"].as_str().and_then(|r| r.rsplit('/').next()) {
        return resolve(schema, &schema["$defs"][name]);
    }
    let some = property["anyOf"].as_array().and_then(|all| all.iter().find(|x| x["type"] != "null"));
    some.map_or(property, |inner| resolve(schema, inner))
}

fn form(schema: &Value, property: &Value) -> String {
    let inner = resolve(schema, property);
    if inner["format"] == FILE_FORMAT {
        return "file".into();
    }
    let names = |all: &Value| -> Vec<String> {
        let name = |x: &Value| match (&x["const"], &x["properties"], &x["enum"]) {
            (Value::String(name), ..) => vec![name.clone()],
            (_, Value::Object(of), _) => of.keys().map(|k| format!("{k}(..)")).collect(),
            (.., Value::Array(of)) => of.iter().filter_map(Value::as_str).map(str::to_owned).collect(),
            _ => Vec::new(),
        };
        all.as_array().into_iter().flatten().flat_map(name).collect()
    };
    if let Some(all) = inner["enum"].as_array() {
        return all.iter().filter_map(Value::as_str).collect::<Vec<_>>().join(" | ");
    }
    if inner["oneOf"].is_array() {
        return names(&inner["oneOf"]).join(" | ");
    }
    match &inner["type"] {
        Value::String(name) => name.clone(),
        Value::Array(all) => all.iter().filter_map(Value::as_str).find(|x| *x != "null").unwrap_or("any").to_owned(),
        _ => "any".into(),
    }
}

/// The RON dialect of graph files: `Some(x)` may be written `x`.
#[must_use]
pub fn ron_options() -> ron::Options {
    ron::Options::default().with_default_extension(Extensions::IMPLICIT_SOME)
}

/// Parses params from the RON text of each given field; finds all errors, each in its field.
pub fn parse<P: DeserializeOwned>(fields: &[(&str, &str)]) -> Result<P, Vec<ParamError>> {
    let whole = match parse_some::<P>(fields) {
        Ok(params) => return Ok(params),
        Err(error) => error,
    };
    let alone = fields.iter().filter_map(|field| match parse_some::<P>(std::slice::from_ref(field)) {
        Ok(_) => None,
        Err(e) if matches!(e.code, ron::Error::MissingStructField { .. }) => None,
        Err(e) => Some(ParamError { param: field.0.to_owned(), span: within(field, &e), message: e.code.to_string() }),
    });
    let mut errors: Vec<_> = alone.collect();
    if errors.is_empty() {
        errors.push(ParamError { param: String::new(), span: 0..0, message: whole.code.to_string() });
    }
    Err(errors)
}

fn parse_some<P: DeserializeOwned>(fields: &[(&str, &str)]) -> Result<P, ron::error::SpannedError> {
    // A newline ends a trailing line comment inside the field's text.
    let body: Vec<String> = fields.iter().map(|(name, text)| format!("{name}:{text}\n")).collect();
    ron_options().from_str(&format!("({})", body.join(",")))
}

/// The error's place within the field's text, from its line and column in `(name:text\n)`.
fn within((name, text): &(&str, &str), error: &ron::error::SpannedError) -> Range<usize> {
    let source = format!("({name}:{text}\n)");
    let prefix = 2 + name.len();
    let offset = |at: ron::error::Position| {
        let line: usize = source.split_inclusive('\n').take(at.line.saturating_sub(1)).map(str::len).sum();
        let rest = source.get(line..).unwrap_or_default();
        let column = rest.char_indices().nth(at.col.saturating_sub(1)).map_or(rest.len(), |(i, _)| i);
        (line + column).saturating_sub(prefix).min(text.len())
    };
    let (start, end) = (offset(error.span.start), offset(error.span.end));
    if start < end { start..end } else { 0..text.len() }
}

/// Finds params with a NaN or an infinity in them. JSON has neither and writes `null`, as it does for `None`, so
/// different params would have one key.
#[must_use]
pub fn not_finite(params: &impl Serialize) -> Vec<ParamError> {
    let written = ron::to_string(params).and_then(|text| ron::from_str(&text).map_err(|e| e.code));
    let fields = match written {
        Ok(ron::Value::Map(fields)) => fields,
        Ok(_) => return Vec::new(),
        Err(e) => {
            let message = format!("these params cannot be written as RON: {e}");
            return vec![ParamError { param: String::new(), span: 0..0, message }];
        }
    };
    let error = |(name, value): (&ron::Value, &ron::Value)| {
        let ron::Value::String(name) = name else { return None };
        let message = format!("`{name}` must be a finite number");
        (!is_finite(value)).then(|| ParamError { param: name.clone(), span: 0..0, message })
    };
    fields.iter().filter_map(error).collect()
}

fn is_finite(value: &ron::Value) -> bool {
    match value {
        ron::Value::Number(number) => number.into_f64().is_finite(),
        ron::Value::Option(inner) => inner.as_deref().is_none_or(is_finite),
        ron::Value::Seq(values) => values.iter().all(is_finite),
        ron::Value::Map(fields) => fields.iter().all(|(name, value)| is_finite(name) && is_finite(value)),
        _ => true,
    }
}

/// Checks every number against its range in the schema.
#[must_use]
pub fn out_of_range(infos: &[ParamInfo], params: &Value) -> Vec<ParamError> {
    let check = |info: &ParamInfo| {
        let value = params[&info.name].as_f64()?;
        let (low, high) = info.range;
        if low.is_none_or(|low| value >= low) && high.is_none_or(|high| value <= high) {
            return None;
        }
        let range = match (low, high) {
            (Some(low), Some(high)) => format!("from {low} to {high}"),
            (Some(low), None) => format!("at least {low}"),
            (None, high) => format!("at most {}", high.unwrap_or(f64::INFINITY)),
        };
        let message = format!("`{}` is {value}; it must be {range}", info.name);
        Some(ParamError { param: info.name.clone(), span: 0..0, message })
    };
    infos.iter().filter_map(check).collect()
}
