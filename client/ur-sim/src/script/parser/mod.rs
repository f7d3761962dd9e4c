//! Tokens to a tree: statements and blocks. Expressions are in `expression`.

mod expression;

use super::error::{ScriptError, ScriptPosition};
use super::lexer::{self, ScriptToken, TokenKind};
use super::limits;
use super::tree::{Do, Expression, Function, Give, Scope, ScriptStatement, Sort};

/// Words that are not names.
const KEYWORDS: [&str; 30] = [
    "def",
    "thread",
    "sec",
    "end",
    "if",
    "elif",
    "else",
    "while",
    "break",
    "continue",
    "return",
    "global",
    "local",
    "run",
    "kill",
    "join",
    "halt",
    "pause",
    "pass",
    "and",
    "or",
    "xor",
    "not",
    "True",
    "False",
    "true",
    "false",
    "None",
    "enter_critical",
    "exit_critical",
];

/// The statements of a whole text.
pub(super) fn statements(text: &str) -> Result<Vec<ScriptStatement>, ScriptError> {
    let mut parser = Parser { tokens: lexer::tokens(text)?, at: 0, blocks: 0, nested: 0 };
    let mut found = Vec::new();
    while parser.peek().kind != TokenKind::End {
        if let Some(word @ ("end" | "elif" | "else")) = parser.word() {
            return Err(parser.wrong(format!("`{word}` without a block that it belongs to")));
        }
        found.push(parser.statement()?);
    }
    Ok(found)
}

struct Parser {
    /// Never empty; the last is [`TokenKind::End`].
    tokens: Vec<ScriptToken>,
    at: usize,
    blocks: u16,
    nested: u16,
}

const NOTHING: ScriptToken =
    ScriptToken { kind: TokenKind::End, position: ScriptPosition { line: 1, column: 1 } };

impl Parser {
    fn peek(&self) -> &ScriptToken {
        self.tokens.get(self.at).or(self.tokens.last()).unwrap_or(&NOTHING)
    }

    fn position(&self) -> ScriptPosition {
        self.peek().position
    }

    fn step(&mut self) {
        self.at = self.at.saturating_add(1);
    }

    /// The name or keyword that comes next.
    fn word(&self) -> Option<&str> {
        if let TokenKind::Name(name) = &self.peek().kind { Some(name) } else { None }
    }

    fn is(&self, symbol: &str) -> bool {
        matches!(self.peek().kind, TokenKind::Symbol(found) if found == symbol)
    }

    /// Steps over the symbol if it comes next.
    fn accept(&mut self, symbol: &str) -> bool {
        let found = self.is(symbol);
        if found {
            self.step();
        }
        found
    }

    fn expect(&mut self, symbol: &str) -> Result<(), ScriptError> {
        if self.accept(symbol) { Ok(()) } else { Err(self.wrong(format!("`{symbol}` wanted"))) }
    }

    /// An error at the next token, which it names.
    fn wrong(&self, message: impl AsRef<str>) -> ScriptError {
        let found = match &self.peek().kind {
            TokenKind::Name(name) => format!("`{}`", lexer::short(name)),
            TokenKind::Value(value) => format!("`{}`", lexer::short(&value.to_string())),
            TokenKind::Symbol(symbol) => format!("`{symbol}`"),
            TokenKind::NewLine => "the end of the line".to_owned(),
            TokenKind::End => "the end of the program".to_owned(),
        };
        ScriptError::new(self.position(), format!("{}, found {found}", message.as_ref()))
    }

    /// A name that is not a keyword.
    fn name(&mut self) -> Result<String, ScriptError> {
        match self.word() {
            Some(name) if !KEYWORDS.contains(&name) => {
                let name = name.to_owned();
                self.step();
                Ok(name)
            }
            _ => Err(self.wrong("a name wanted")),
        }
    }

    fn new_lines(&mut self) {
        while self.peek().kind == TokenKind::NewLine {
            self.step();
        }
    }

    /// After a statement. Another one may follow on the same line, as in the program that ur_rtde sends.
    fn end_of_statement(&mut self) -> Result<(), ScriptError> {
        match self.peek().kind {
            TokenKind::NewLine => self.step(),
            TokenKind::Name(_) => {}
            _ => return Err(self.wrong("the end of the line wanted")),
        }
        Ok(())
    }

    /// What is assigned, on the same line as the `=` or on a later one.
    fn assigned(&mut self) -> Result<Expression, ScriptError> {
        self.new_lines();
        self.expression()
    }

    /// The statements up to one of the words `until`, which stays.
    fn block(&mut self, opened: ScriptPosition, until: &[&str]) -> Result<Vec<ScriptStatement>, ScriptError> {
        self.expect(":")?;
        if self.peek().kind == TokenKind::NewLine {
            self.step();
        }
        if self.blocks >= limits::BLOCK_DEPTH {
            return Err(ScriptError::new(opened, format!("blocks are deeper than {}", limits::BLOCK_DEPTH)));
        }
        self.blocks += 1;
        let mut body = Vec::new();
        loop {
            match self.word() {
                Some(word) if until.contains(&word) => break,
                Some(word @ ("elif" | "else")) => {
                    return Err(self.wrong(format!("`{word}` without an `if` before it")));
                }
                _ if self.peek().kind == TokenKind::End => {
                    let message = format!("the block that begins in line {} has no `end`", opened.line);
                    return Err(ScriptError::new(self.position(), message));
                }
                _ => body.push(self.statement()?),
            }
        }
        self.blocks -= 1;
        Ok(body)
    }

    fn statement(&mut self) -> Result<ScriptStatement, ScriptError> {
        let position = self.position();
        let word = self.word().unwrap_or_default().to_owned();
        let keyword = KEYWORDS.contains(&word.as_str());
        if keyword {
            self.step();
        }
        let what = match word.as_str() {
            "def" => Do::Define(self.function(Sort::Def, position)?),
            "thread" => Do::Define(self.function(Sort::Thread, position)?),
            "sec" => Do::Define(self.function(Sort::Sec, position)?),
            "if" => self.condition(position)?,
            "while" => {
                let condition = self.expression()?;
                let body = self.block(position, &["end"])?;
                self.step();
                Do::While(condition, body)
            }
            "global" => self.declaration(Scope::Global)?,
            "local" => self.declaration(Scope::Local)?,
            "return" if self.peek().kind == TokenKind::NewLine => Do::Return(None),
            "return" => Do::Return(Some(self.expression()?)),
            "kill" => Do::Kill(self.expression()?),
            "join" => Do::Join(self.expression()?),
            "break" => Do::Break,
            "continue" => Do::Continue,
            "pass" => Do::Pass,
            "halt" => self.bare(Do::Halt)?,
            "pause" => self.bare(Do::Pause)?,
            "enter_critical" => self.bare(Do::EnterCritical)?,
            "exit_critical" => self.bare(Do::ExitCritical)?,
            _ => {
                if keyword {
                    self.at = self.at.saturating_sub(1);
                }
                self.assignment_or_call()?
            }
        };
        self.end_of_statement()?;
        Ok(ScriptStatement { position, what })
    }

    /// A statement of one word, which may be written like a call.
    fn bare(&mut self, what: Do) -> Result<Do, ScriptError> {
        if self.accept("(") {
            self.expect(")")?;
        }
        Ok(what)
    }

    fn declaration(&mut self, scope: Scope) -> Result<Do, ScriptError> {
        let name = self.name()?;
        let value = if self.accept("=") { Some(self.assigned()?) } else { None };
        Ok(Do::Assign { scope, name, indices: Vec::new(), value })
    }

    fn assignment_or_call(&mut self) -> Result<Do, ScriptError> {
        let left = self.expression()?;
        if !self.is("=") {
            return Ok(Do::Evaluate(left));
        }
        let wrong = self.wrong("only a variable or an element of one can be assigned to");
        self.step();
        let (name, indices) = match left.what {
            Give::Name(name) => (name, Vec::new()),
            Give::Index(of, indices) => match of.what {
                Give::Name(name) => (name, indices),
                _ => return Err(wrong),
            },
            _ => return Err(wrong),
        };
        Ok(Do::Assign { scope: Scope::Free, name, indices, value: Some(self.assigned()?) })
    }

    /// `if` is read; up to and including its `end`.
    fn condition(&mut self, position: ScriptPosition) -> Result<Do, ScriptError> {
        let mut arms = vec![(self.expression()?, self.block(position, &["elif", "else", "end"])?)];
        while self.word() == Some("elif") {
            let position = self.position();
            self.step();
            arms.push((self.expression()?, self.block(position, &["elif", "else", "end"])?));
        }
        let mut otherwise = Vec::new();
        if self.word() == Some("else") {
            let position = self.position();
            self.step();
            otherwise = self.block(position, &["end"])?;
        }
        self.step();
        Ok(Do::If { arms, otherwise })
    }

    /// The word before the name is read.
    fn function(&mut self, sort: Sort, position: ScriptPosition) -> Result<Function, ScriptError> {
        let name = self.name()?;
        let mut parameters: Vec<(String, Option<Expression>)> = Vec::new();
        self.expect("(")?;
        while !self.accept(")") {
            let at = self.position();
            let parameter = self.name()?;
            if parameters.iter().any(|(other, _)| *other == parameter) {
                return Err(ScriptError::new(at, format!("parameter {parameter} stands there twice")));
            }
            let default = if self.accept("=") { Some(self.expression()?) } else { None };
            if default.is_none() && parameters.last().is_some_and(|(_, before)| before.is_some()) {
                let message = "a parameter without a default stands after one with a default";
                return Err(ScriptError::new(at, message));
            }
            parameters.push((parameter, default));
            if parameters.len() > limits::ARGUMENTS {
                return Err(ScriptError::more_than(at, limits::ARGUMENTS, "parameters"));
            }
            if !self.is(")") {
                self.expect(",")?;
            }
        }
        if sort == Sort::Thread && !parameters.is_empty() {
            return Err(ScriptError::new(position, "a thread has no parameters"));
        }
        let body = self.block(position, &["end"])?;
        self.step();
        Ok(Function { name, sort, position, parameters, body })
    }
}
