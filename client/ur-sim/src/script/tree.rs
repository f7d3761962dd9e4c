//! The tree of a program: what the parser makes and the compiler reads.

use super::error::{ScriptError, ScriptPosition};
use super::limits;
use super::value::Value;

/// How a function was defined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sort {
    Def,
    Thread,
    Sec,
}

#[derive(Debug)]
pub(super) struct Function {
    pub(super) name: String,
    pub(super) sort: Sort,
    pub(super) position: ScriptPosition,
    /// Names with their default values.
    pub(super) parameters: Vec<(String, Option<Expression>)>,
    pub(super) body: Vec<ScriptStatement>,
}

#[derive(Debug)]
pub(super) struct ScriptStatement {
    pub(super) position: ScriptPosition,
    pub(super) what: Do,
}

/// Where an assigned name is looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scope {
    /// Where it is known already, else in the function (the manual's "free" variable).
    Free,
    Local,
    Global,
}

#[derive(Debug)]
pub(super) enum Do {
    Define(Function),
    /// `indices` is empty for a whole variable; no value only declares it.
    Assign {
        scope: Scope,
        name: String,
        indices: Vec<Expression>,
        value: Option<Expression>,
    },
    If {
        arms: Vec<(Expression, Vec<ScriptStatement>)>,
        otherwise: Vec<ScriptStatement>,
    },
    While(Expression, Vec<ScriptStatement>),
    Break,
    Continue,
    Return(Option<Expression>),
    Kill(Expression),
    Join(Expression),
    Halt,
    Pause,
    EnterCritical,
    ExitCritical,
    Pass,
    Evaluate(Expression),
}

#[derive(Debug)]
pub(super) struct Expression {
    pub(super) position: ScriptPosition,
    pub(super) what: Give,
    depth: u16,
}

#[derive(Debug)]
pub(super) enum Give {
    Value(Value),
    Name(String),
    List(Vec<Expression>),
    Pose(Vec<Expression>),
    /// One index, or two for a matrix.
    Index(Box<Expression>, Vec<Expression>),
    Call(CallExpression),
    Run(CallExpression),
    Unary(Unary, Box<Expression>),
    Binary(Binary, Box<Expression>, Box<Expression>),
}

/// A call as written.
#[derive(Debug)]
pub(super) struct CallExpression {
    pub(super) name: String,
    pub(super) positional: Vec<Expression>,
    pub(super) named: Vec<(String, Expression)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unary {
    Not,
    Minus,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Binary {
    Or,
    Xor,
    And,
    Equal,
    Differs,
    Below,
    BelowOrEqual,
    Above,
    AboveOrEqual,
    Add,
    Subtract,
    Multiply,
    Divide,
    Remainder,
}

impl Expression {
    /// Fails where the tree would become deeper than [`limits::EXPRESSION_DEPTH`].
    pub(super) fn new(position: ScriptPosition, what: Give) -> Result<Self, ScriptError> {
        let deepest = |list: &[Self]| list.iter().map(|inner| inner.depth).max().unwrap_or(0);
        let below = match &what {
            Give::Value(_) | Give::Name(_) => 0,
            Give::List(list) | Give::Pose(list) => deepest(list),
            Give::Index(of, at) => of.depth.max(deepest(at)),
            Give::Call(asked) | Give::Run(asked) => {
                let named = asked.named.iter().map(|(_, inner)| inner.depth).max().unwrap_or(0);
                deepest(&asked.positional).max(named)
            }
            Give::Unary(_, of) => of.depth,
            Give::Binary(_, left, right) => left.depth.max(right.depth),
        };
        if below >= limits::EXPRESSION_DEPTH {
            return Err(ScriptError::new(
                position,
                format!("this is deeper than {}", limits::EXPRESSION_DEPTH),
            ));
        }
        Ok(Self { position, what, depth: below + 1 })
    }
}
