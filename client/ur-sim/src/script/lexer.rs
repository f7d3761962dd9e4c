//! Text to tokens. Newlines end statements, but not inside brackets; comments and program labels
//! (`$ 1 "..."`) are skipped.

use super::error::{ScriptError, ScriptPosition};
use super::limits;
use super::value::Value;
use std::iter::Peekable;
use std::str::Chars;

/// What a token is.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum TokenKind {
    /// A name or a keyword.
    Name(String),
    /// A number or a string.
    Value(Value),
    /// An operator or a bracket; `p[` opens a pose.
    Symbol(&'static str),
    NewLine,
    End,
}

/// A token and where it begins.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ScriptToken {
    pub(super) kind: TokenKind,
    pub(super) position: ScriptPosition,
}

/// Two letters first, because the longer one is meant.
const SYMBOLS: [&str; 18] =
    ["==", "!=", "<=", ">=", "p[", "(", ")", "[", "]", ",", ":", "=", "<", ">", "+", "-", "*", "/"];

/// The tokens of `text`, the last of which is [`TokenKind::End`].
pub(super) fn tokens(text: &str) -> Result<Vec<ScriptToken>, ScriptError> {
    if text.len() > limits::TEXT_BYTES {
        let message = format!("the program is longer than {} bytes", limits::TEXT_BYTES);
        return Err(ScriptError::new(ScriptPosition { line: 1, column: 1 }, message));
    }
    let mut reader =
        TextScanner { rest: text.chars().peekable(), position: ScriptPosition { line: 1, column: 1 } };
    let mut found: Vec<ScriptToken> = Vec::new();
    let mut open: Vec<ScriptPosition> = Vec::new();
    while let Some(&next) = reader.rest.peek() {
        let position = reader.position;
        let line_is_empty = found.last().is_none_or(|token| token.kind == TokenKind::NewLine);
        let kind = match next {
            '\n' => {
                reader.step();
                if line_is_empty || !open.is_empty() {
                    continue;
                }
                TokenKind::NewLine
            }
            ' ' | '\t' | '\r' | '\u{c}' | '\u{feff}' => {
                reader.step();
                continue;
            }
            '#' => {
                reader.take(|c| c != '\n');
                continue;
            }
            '$' if line_is_empty => {
                reader.take(|c| c != '\n');
                continue;
            }
            '"' | '\'' => TokenKind::Value(reader.text(next, position)?),
            '0'..='9' | '.' => TokenKind::Value(reader.number(position)?),
            c if c.is_ascii_alphabetic() || c == '_' => {
                let name = reader.take(|c| c.is_ascii_alphanumeric() || c == '_');
                if name == "p" && reader.rest.peek() == Some(&'[') {
                    reader.step();
                    TokenKind::Symbol("p[")
                } else {
                    TokenKind::Name(name)
                }
            }
            _ => TokenKind::Symbol(reader.symbol(position)?),
        };
        match kind {
            TokenKind::Symbol("(" | "[" | "p[") => open.push(position),
            TokenKind::Symbol(")" | "]") if open.pop().is_none() => {
                return Err(ScriptError::new(position, "this bracket closes nothing"));
            }
            _ => {}
        }
        found.push(ScriptToken { kind, position });
    }
    if let Some(&position) = open.first() {
        return Err(ScriptError::new(position, "this bracket is not closed"));
    }
    if found.last().is_some_and(|last| last.kind != TokenKind::NewLine) {
        found.push(ScriptToken { kind: TokenKind::NewLine, position: reader.position });
    }
    found.push(ScriptToken { kind: TokenKind::End, position: reader.position });
    Ok(found)
}

struct TextScanner<'a> {
    rest: Peekable<Chars<'a>>,
    position: ScriptPosition,
}

impl TextScanner<'_> {
    fn step(&mut self) -> Option<char> {
        let next = self.rest.next()?;
        if next == '\n' {
            self.position = ScriptPosition { line: self.position.line.saturating_add(1), column: 1 };
        } else {
            self.position.column = self.position.column.saturating_add(1);
        }
        Some(next)
    }

    /// What comes next as long as it is `wanted`.
    fn take(&mut self, wanted: impl Fn(char) -> bool) -> String {
        let mut taken = String::new();
        while let Some(&next) = self.rest.peek() {
            if !wanted(next) {
                break;
            }
            taken.push(next);
            self.step();
        }
        taken
    }

    fn text(&mut self, quote: char, position: ScriptPosition) -> Result<Value, ScriptError> {
        self.step();
        let text = self.take(|c| c != quote && c != '\n');
        if self.rest.peek() != Some(&quote) {
            return Err(ScriptError::new(position, "this string is not closed on its line"));
        }
        self.step();
        if text.len() > limits::STRING_BYTES {
            let message = format!("a string has at most {} bytes", limits::STRING_BYTES);
            return Err(ScriptError::new(position, message));
        }
        Ok(Value::text(&text))
    }

    /// Digits with a point, an exponent or both are a float; else an integer, or a float where 32 bits are
    /// too few.
    fn number(&mut self, position: ScriptPosition) -> Result<Value, ScriptError> {
        let mut written = self.take(|c| c.is_ascii_digit() || c == '.');
        if self.rest.peek().is_some_and(|&c| c == 'e' || c == 'E') {
            written.extend(self.step());
            if self.rest.peek().is_some_and(|&c| c == '+' || c == '-') {
                written.extend(self.step());
            }
            written += &self.take(|c| c.is_ascii_digit());
        }
        let glued = self.take(|c| c.is_ascii_alphanumeric() || c == '_');
        if glued.is_empty() {
            if let Ok(integer) = written.parse() {
                return Ok(Value::Integer(integer));
            }
            if let Ok(float) = written.parse::<f64>() {
                return Ok(Value::Float(float));
            }
        }
        Err(ScriptError::new(position, format!("{} is no number", short(&(written + &glued)))))
    }

    fn symbol(&mut self, position: ScriptPosition) -> Result<&'static str, ScriptError> {
        let Some(first) = self.step() else {
            return Err(ScriptError::new(position, "the program ends here"));
        };
        if first == '%' {
            return Ok("%");
        }
        let second = self.rest.peek().copied();
        for symbol in SYMBOLS {
            let mut letters = symbol.chars();
            if letters.next() != Some(first) {
                continue;
            }
            match letters.next() {
                None => return Ok(symbol),
                wanted if wanted == second => {
                    self.step();
                    return Ok(symbol);
                }
                _ => {}
            }
        }
        Err(ScriptError::new(position, format!("the character {first:?} means nothing here")))
    }
}

/// The beginning of a text, for messages.
pub(super) fn short(text: &str) -> String {
    let mut short: String = text.chars().take(40).collect();
    if short.len() < text.len() {
        short += "...";
    }
    short
}
