//! Reading a TOML document section by section, with the place of everything that is wrong.
//!
//! A [`Section`] refuses unknown keys when it is opened, before any of its values is read: a misspelt key is then named
//! as such, not as the absence of the right one.

use std::ops::{Range, RangeInclusive};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::ConfigError;
use super::spelling::closest;
use crate::setting::SettingError;

/// Longest text that a message quotes, characters.
const QUOTED_MAX: usize = 40;
/// Longest name or path that is accepted, characters.
const TEXT_MAX: usize = 256;

/// The text of a configuration, of one file or several, and what they are called.
///
/// A place is a byte in all texts end to end, so that a message can name the file it is in.
pub(super) struct Document {
    /// All texts end to end.
    text: String,
    /// Where each file starts, and its name.
    files: Vec<(usize, String)>,
    /// Each text behind as many line ends as there are bytes before it: its places are then those of `text`.
    padded: Vec<String>,
}

impl Document {
    /// Names and texts; a later file adds to the earlier ones, and what it sets again holds.
    pub(super) fn new(files: &[(String, String)]) -> Self {
        let mut document = Self {
            text: String::new(),
            files: Vec::new(),
            padded: Vec::new(),
        };
        for (name, text) in files {
            let start = document.text.len();
            document.files.push((start, name.clone()));
            document.padded.push("\n".repeat(start) + text);
            document.text.push_str(text);
        }
        document
    }

    pub(super) fn parse(&self) -> Result<DeTable<'_>, ConfigError> {
        let mut whole = DeTable::new();
        for (padded, (start, name)) in self.padded.iter().zip(&self.files) {
            let table = DeTable::parse(padded).map_err(|error| ConfigError::Syntax {
                file: name.clone(),
                line: self.line(error.span().map_or(*start, |span| span.start.max(*start))),
                message: error.message().lines().collect::<Vec<_>>().join("; "),
            })?;
            merge(&mut whole, table.into_inner());
        }
        Ok(whole)
    }

    /// The file that a byte is in.
    fn file(&self, offset: usize) -> &(usize, String) {
        let later = self.files.iter().rposition(|(start, _)| *start <= offset);
        &self.files[later.unwrap_or(0)]
    }

    /// Line of a byte in its file, from 1.
    fn line(&self, offset: usize) -> usize {
        let start = self.file(offset).0;
        let before = self.text.get(start..offset).unwrap_or_default();
        1 + before.bytes().filter(|&byte| byte == b'\n').count()
    }

    fn quote(&self, span: Range<usize>) -> String {
        cut(self.text.get(span).unwrap_or_default())
    }
}

/// One table of the document, or the absence of it, which reads as an empty one.
#[derive(Clone)]
pub(super) struct Section<'a> {
    document: &'a Document,
    /// Key path, empty for the root.
    path: String,
    table: Option<&'a DeTable<'a>>,
    /// Byte at which the section starts.
    start: usize,
}

impl<'a> Section<'a> {
    pub(super) fn root(document: &'a Document, table: &'a DeTable<'a>, keys: &[&str]) -> Result<Self, ConfigError> {
        let root = Self {
            document,
            path: String::new(),
            table: Some(table),
            start: 0,
        };
        root.refuse_unknown(keys)?;
        Ok(root)
    }

    /// The table under `key`, which may have only the keys `keys`; empty if the document has none.
    pub(super) fn section(&self, key: &str, keys: &[&str]) -> Result<Self, ConfigError> {
        let section = match self.get(key) {
            Some(value) => self.open(self.path_of(key), value)?,
            None => Self {
                path: self.path_of(key),
                table: None,
                ..self.clone()
            },
        };
        section.refuse_unknown(keys)?;
        Ok(section)
    }

    /// The table under `key`, whatever its keys; `None` if the document has none.
    pub(super) fn table(&self, key: &str) -> Result<Option<Self>, ConfigError> {
        self.get(key)
            .map(|value| self.open(self.path_of(key), value))
            .transpose()
    }

    /// The named tables under `key`, in order of name, each with only the keys `keys`.
    pub(super) fn named_sections(&self, key: &str, keys: &[&str]) -> Result<Vec<(&'a str, Self)>, ConfigError> {
        let Some(value) = self.get(key) else {
            return Ok(Vec::new());
        };
        let parent = self.open(self.path_of(key), value)?;
        let mut sections = Vec::new();
        for (name, _) in parent.table.into_iter().flatten() {
            sections.push((name.get_ref().as_ref(), parent.section(name.get_ref(), keys)?));
        }
        Ok(sections)
    }

    /// The array of tables under `key`, each with only the keys `keys`; `None` if the document has no such key.
    pub(super) fn list(&self, key: &str, keys: &[&str]) -> Result<Option<Vec<Self>>, ConfigError> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let DeValue::Array(items) = value.get_ref() else {
            return Err(self.refuse(key, "an array of tables ([[…]])"));
        };
        let mut sections = Vec::with_capacity(items.len());
        for (i, item) in items.iter().enumerate() {
            let section = self.open(format!("{}[{i}]", self.path_of(key)), item)?;
            section.refuse_unknown(keys)?;
            sections.push(section);
        }
        Ok(Some(sections))
    }

    /// A finite number within `range`.
    pub(super) fn number(&self, key: &str, default: f64, range: RangeInclusive<f64>) -> Result<f64, ConfigError> {
        let expected = || format!("a number from {} to {}", range.start(), range.end());
        match self.any_number(key, expected)? {
            Some(value) if range.contains(&value) => Ok(value),
            Some(_) => Err(self.refuse(key, &expected())),
            None => Ok(default),
        }
    }

    /// Any number, NaN and infinities included, if the document sets `key`; its owner checks it.
    pub(super) fn any_number(&self, key: &str, expected: impl FnOnce() -> String) -> Result<Option<f64>, ConfigError> {
        let number = match self.get(key).map(Spanned::get_ref) {
            None => return Ok(None),
            // All digits of a TOML integer are kept by the parser; beyond 64 bits it is no sensible setting.
            Some(DeValue::Integer(i)) => i64::from_str_radix(i.as_str(), i.radix()).ok().map(|i| i as f64),
            Some(DeValue::Float(x)) => x.as_str().parse().ok(),
            Some(_) => None,
        };
        number.map(Some).ok_or_else(|| self.refuse(key, &expected()))
    }

    /// An integer within `range`; `None` if the document does not set `key`.
    pub(super) fn integer(&self, key: &str, range: RangeInclusive<u32>) -> Result<Option<u32>, ConfigError> {
        let number = match self.get(key).map(Spanned::get_ref) {
            None => return Ok(None),
            Some(DeValue::Integer(i)) => u32::from_str_radix(i.as_str(), i.radix()).ok(),
            Some(_) => None,
        };
        match number {
            Some(value) if range.contains(&value) => Ok(Some(value)),
            _ => Err(self.refuse(
                key,
                &format!("a whole number from {} to {}", range.start(), range.end()),
            )),
        }
    }

    pub(super) fn flag(&self, key: &str, default: bool) -> Result<bool, ConfigError> {
        match self.get(key).map(Spanned::get_ref) {
            None => Ok(default),
            Some(DeValue::Boolean(value)) => Ok(*value),
            Some(_) => Err(self.refuse(key, "true or false")),
        }
    }

    /// Text without control characters; `None` if the document does not set `key`.
    pub(super) fn text(&self, key: &str) -> Result<Option<String>, ConfigError> {
        match self.get(key).map(Spanned::get_ref) {
            None => Ok(None),
            Some(DeValue::String(text))
                if !text.trim().is_empty()
                    && text.chars().count() <= TEXT_MAX
                    && !text.chars().any(char::is_control) =>
            {
                Ok(Some(text.to_string()))
            }
            Some(_) => Err(self.refuse(
                key,
                &format!("a text of 1 to {TEXT_MAX} printable characters in quotes"),
            )),
        }
    }

    /// Whether the document sets `key`, and to a table.
    pub(super) fn is_table(&self, key: &str) -> bool {
        self.get(key)
            .is_some_and(|value| matches!(value.get_ref(), DeValue::Table(_)))
    }

    /// Whether the document sets `key`, and to a text.
    pub(super) fn is_text(&self, key: &str) -> bool {
        self.get(key)
            .is_some_and(|value| matches!(value.get_ref(), DeValue::String(_)))
    }

    /// Whether the document sets `key`.
    pub(super) fn has(&self, key: &str) -> bool {
        self.get(key).is_some()
    }

    /// The keys that the document sets here, each with the file and line of its value.
    pub(super) fn places(&self) -> impl Iterator<Item = (&'a str, String)> {
        let document = self.document;
        self.table.into_iter().flatten().map(move |(key, value)| {
            let start = value.span().start;
            let place = format!("{}:{}", document.file(start).1, document.line(start));
            (key.get_ref().as_ref(), place)
        })
    }

    /// One text, or an array of them; empty if the document does not set `key`.
    pub(super) fn texts(&self, key: &str) -> Result<Vec<String>, ConfigError> {
        let Some(DeValue::Array(items)) = self.get(key).map(Spanned::get_ref) else {
            return Ok(self.text(key)?.into_iter().collect());
        };
        let text = |item: &Spanned<DeValue<'_>>| item.get_ref().as_str().map(str::to_owned);
        let texts: Option<Vec<_>> = items.iter().map(text).collect();
        texts.ok_or_else(|| self.refuse(key, "a text in quotes, or an array of them"))
    }

    /// One of the given words.
    pub(super) fn choice<T: Copy>(&self, key: &str, default: T, choices: &[(&str, T)]) -> Result<T, ConfigError> {
        let word = match self.get(key).map(Spanned::get_ref) {
            None => return Ok(default),
            Some(DeValue::String(word)) => word.as_ref(),
            Some(_) => "",
        };
        choices
            .iter()
            .find(|(name, _)| *name == word)
            .map(|(_, choice)| *choice)
            .ok_or_else(|| {
                let names: Vec<_> = choices.iter().map(|(name, _)| format!("{name:?}")).collect();
                self.refuse(key, &names.join(" or "))
            })
    }

    /// The error that the value of `key`, or its absence, is not `expected`.
    pub(super) fn refuse(&self, key: &str, expected: &str) -> ConfigError {
        self.refuse_effective(key, expected, "no such key")
    }

    /// The same for a value that may come from a default: `effective` is then what was found.
    pub(super) fn refuse_effective(&self, key: &str, expected: &str, effective: &str) -> ConfigError {
        let (start, found) = match self.get(key) {
            None => (self.start, effective.to_owned()),
            Some(value) => {
                let found = match value.get_ref() {
                    DeValue::Table(_) => "a table".to_owned(),
                    DeValue::Array(_) => "an array".to_owned(),
                    _ => self.document.quote(value.span()),
                };
                (value.span().start, found)
            }
        };
        self.value_error(start, self.path_of(key), expected, found)
    }

    /// The error that a setting of this section, set or by default, is against another one or against a rate.
    pub(super) fn refuse_setting(&self, refused: &SettingError) -> ConfigError {
        let effective = format!("{} (not set here)", refused.got);
        self.refuse_effective(refused.field, &refused.expected.to_string(), &effective)
    }

    /// The error that the section itself is not `expected`.
    pub(super) fn refuse_self(&self, expected: &str, found: &str) -> ConfigError {
        self.value_error(self.start, self.path.clone(), expected, cut(found))
    }

    fn value_error(&self, start: usize, key: String, expected: &str, found: String) -> ConfigError {
        let (file, line) = (self.document.file(start).1.clone(), self.document.line(start));
        ConfigError::Value {
            file,
            line,
            key,
            expected: expected.to_owned(),
            found,
        }
    }

    fn refuse_unknown(&self, keys: &[&str]) -> Result<(), ConfigError> {
        let unknown = self
            .table
            .into_iter()
            .flatten()
            .find(|(key, _)| !keys.contains(&key.get_ref().as_ref()));
        let Some((key, _)) = unknown else { return Ok(()) };
        let hint = match closest(key.get_ref(), keys) {
            Some(known) => format!("did you mean {known}?"),
            None => format!("known here: {}", keys.join(", ")),
        };
        Err(ConfigError::UnknownKey {
            file: self.document.file(key.span().start).1.clone(),
            line: self.document.line(key.span().start),
            key: self.path_of(key.get_ref()),
            hint,
        })
    }

    fn open(&self, path: String, value: &'a Spanned<DeValue<'a>>) -> Result<Self, ConfigError> {
        let start = value.span().start;
        match value.get_ref() {
            DeValue::Table(table) => Ok(Self {
                document: self.document,
                path,
                table: Some(table),
                start,
            }),
            DeValue::Array(_) => Err(self.value_error(start, path, "a table", "an array".to_owned())),
            _ => Err(self.value_error(start, path, "a table", self.document.quote(value.span()))),
        }
    }

    fn get(&self, key: &str) -> Option<&'a Spanned<DeValue<'a>>> {
        self.table?.get(key)
    }

    fn path_of(&self, key: &str) -> String {
        let bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        let key = if !key.is_empty() && key.chars().all(bare) {
            cut(key)
        } else {
            format!("\"{}\"", cut(key))
        };
        if self.path.is_empty() {
            key
        } else {
            format!("{}.{key}", self.path)
        }
    }
}

/// Adds a later file: tables go together key by key, arrays of tables one behind the other; anything else is replaced.
fn merge<'a>(whole: &mut DeTable<'a>, later: DeTable<'a>) {
    for (key, value) in later {
        match (
            whole.get_mut(&key).map(Spanned::get_mut),
            (value.span(), value.into_inner()),
        ) {
            (Some(DeValue::Table(known)), (_, DeValue::Table(more))) => merge(known, more),
            (Some(DeValue::Array(known)), (_, DeValue::Array(more))) => {
                more.into_iter().for_each(|item| known.push(item));
            }
            (_, (span, value)) => {
                whole.insert(key, Spanned::new(span, value));
            }
        }
    }
}

/// Text as it can stand in one line of a message.
fn cut(text: &str) -> String {
    let mut chars = text.chars();
    let mut quoted: String = chars.by_ref().take(QUOTED_MAX).flat_map(escape_control).collect();
    if chars.next().is_some() {
        quoted.push('…');
    }
    quoted
}

fn escape_control(c: char) -> Vec<char> {
    if c.is_control() {
        c.escape_default().collect()
    } else {
        vec![c]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotes_stay_on_one_short_line() {
        assert_eq!(cut("a\nb"), "a\\nb");
        assert_eq!(cut(&"x".repeat(50)).chars().count(), QUOTED_MAX + 1);
    }
}
