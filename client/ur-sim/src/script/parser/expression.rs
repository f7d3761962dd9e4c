//! Expressions: how strongly operators bind, from `or` (weakest) to an index (strongest).

use super::super::error::ScriptError;
use super::super::lexer::TokenKind;
use super::super::limits;
use super::super::tree::{Binary, CallExpression, Expression, Give, Unary};
use super::super::value::Value;
use super::{KEYWORDS, Parser};

const NOT_BINDS: u8 = 3;
const MINUS_BINDS: u8 = 7;

impl Parser {
    pub(super) fn expression(&mut self) -> Result<Expression, ScriptError> {
        self.bound(0)
    }

    /// The longest expression whose operators bind more strongly than `weakest`.
    fn bound(&mut self, weakest: u8) -> Result<Expression, ScriptError> {
        if self.nested >= limits::EXPRESSION_DEPTH {
            let message = format!("this is deeper than {}", limits::EXPRESSION_DEPTH);
            return Err(ScriptError::new(self.position(), message));
        }
        self.nested += 1;
        let mut left = self.prefixed()?;
        while let Some((operator, binds)) = self.operator() {
            if binds <= weakest {
                break;
            }
            let position = self.position();
            self.step();
            // A line that ends in an operator goes on in the next.
            self.new_lines();
            let right = self.bound(binds)?;
            left = Expression::new(position, Give::Binary(operator, Box::new(left), Box::new(right)))?;
        }
        self.nested -= 1;
        Ok(left)
    }

    fn operator(&self) -> Option<(Binary, u8)> {
        Some(match &self.peek().kind {
            TokenKind::Name(word) => match word.as_str() {
                "or" => (Binary::Or, 1),
                "xor" => (Binary::Xor, 1),
                "and" => (Binary::And, 2),
                _ => return None,
            },
            TokenKind::Symbol(symbol) => match *symbol {
                "==" => (Binary::Equal, 4),
                "!=" => (Binary::Differs, 4),
                "<" => (Binary::Below, 4),
                "<=" => (Binary::BelowOrEqual, 4),
                ">" => (Binary::Above, 4),
                ">=" => (Binary::AboveOrEqual, 4),
                "+" => (Binary::Add, 5),
                "-" => (Binary::Subtract, 5),
                "*" => (Binary::Multiply, 6),
                "/" => (Binary::Divide, 6),
                "%" => (Binary::Remainder, 6),
                _ => return None,
            },
            _ => return None,
        })
    }

    fn prefixed(&mut self) -> Result<Expression, ScriptError> {
        let position = self.position();
        let (operator, binds) = match &self.peek().kind {
            TokenKind::Name(word) if word == "not" => (Some(Unary::Not), NOT_BINDS),
            TokenKind::Symbol("-") => (Some(Unary::Minus), MINUS_BINDS),
            TokenKind::Symbol("+") => (None, MINUS_BINDS),
            _ => return self.indexed(),
        };
        self.step();
        let operand = self.bound(binds)?;
        match operator {
            Some(operator) => Expression::new(position, Give::Unary(operator, Box::new(operand))),
            None => Ok(operand),
        }
    }

    fn indexed(&mut self) -> Result<Expression, ScriptError> {
        let mut of = self.single()?;
        while self.is("[") {
            let position = self.position();
            self.step();
            let mut indices = vec![self.expression()?];
            if self.accept(",") {
                indices.push(self.expression()?);
            }
            self.expect("]")?;
            of = Expression::new(position, Give::Index(Box::new(of), indices))?;
        }
        Ok(of)
    }

    fn single(&mut self) -> Result<Expression, ScriptError> {
        let position = self.position();
        let what = match self.peek().kind.clone() {
            TokenKind::Value(value) => {
                self.step();
                Give::Value(value)
            }
            TokenKind::Symbol("(") => {
                self.step();
                let inner = self.expression()?;
                self.expect(")")?;
                return Ok(inner);
            }
            TokenKind::Symbol("[") => {
                self.step();
                Give::List(self.elements()?)
            }
            TokenKind::Symbol("p[") => {
                self.step();
                let elements = self.elements()?;
                match elements.len() {
                    6 => Give::Pose(elements),
                    // A variable may be called p, and ur_rtde's program has one.
                    1 | 2 => {
                        let of = Expression::new(position, Give::Name("p".to_owned()))?;
                        Give::Index(Box::new(of), elements)
                    }
                    count => {
                        return Err(ScriptError::new(position, format!("a pose has 6 numbers, not {count}")));
                    }
                }
            }
            TokenKind::Name(word) => match word.as_str() {
                "True" | "true" | "False" | "false" => {
                    self.step();
                    Give::Value(Value::Bool(matches!(word.as_str(), "True" | "true")))
                }
                "None" => {
                    self.step();
                    Give::Value(Value::None)
                }
                "run" => {
                    self.step();
                    let name = self.name()?;
                    self.expect("(")?;
                    Give::Run(self.arguments(name)?)
                }
                word if KEYWORDS.contains(&word) => return Err(self.wrong("a value wanted")),
                _ => {
                    self.step();
                    if self.accept("(") { Give::Call(self.arguments(word)?) } else { Give::Name(word) }
                }
            },
            _ => return Err(self.wrong("a value wanted")),
        };
        Expression::new(position, what)
    }

    /// Up to and including the `]`.
    fn elements(&mut self) -> Result<Vec<Expression>, ScriptError> {
        let mut elements = Vec::new();
        while !self.accept("]") {
            elements.push(self.expression()?);
            if elements.len() > limits::LITERAL {
                return Err(ScriptError::more_than(self.position(), limits::LITERAL, "elements"));
            }
            if !self.is("]") {
                self.expect(",")?;
            }
        }
        Ok(elements)
    }

    /// Up to and including the `)`; `name=value` makes a named one.
    fn arguments(&mut self, name: String) -> Result<CallExpression, ScriptError> {
        let mut asked = CallExpression { name, positional: Vec::new(), named: Vec::new() };
        while !self.accept(")") {
            let value = self.expression()?;
            if self.is("=") {
                let Give::Name(parameter) = value.what else {
                    return Err(ScriptError::new(value.position, "a parameter's name wanted before `=`"));
                };
                if asked.named.iter().any(|(other, _)| *other == parameter) {
                    let message = format!("argument {parameter} is given twice");
                    return Err(ScriptError::new(value.position, message));
                }
                self.step();
                asked.named.push((parameter, self.expression()?));
            } else if asked.named.is_empty() {
                asked.positional.push(value);
            } else {
                let message = "an argument without a name stands after one with a name";
                return Err(ScriptError::new(value.position, message));
            }
            if asked.positional.len() + asked.named.len() > limits::ARGUMENTS {
                return Err(ScriptError::more_than(self.position(), limits::ARGUMENTS, "arguments"));
            }
            if !self.is(")") {
                self.expect(",")?;
            }
        }
        Ok(asked)
    }
}
