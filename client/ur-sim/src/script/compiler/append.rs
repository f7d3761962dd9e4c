//! Statements for a program in interpreter mode: compiled behind the program that runs, in the scope of the
//! call that waits for them.

use super::super::code::{Code, Op};
use super::super::error::ScriptError;
use super::super::limits;
use super::super::tree::{Do, Function, Scope, ScriptStatement};
use super::Compiler;
use super::scope::{self, FunctionScope, Names};
use std::collections::HashMap;

/// Where statements are to stand.
#[derive(Debug, Clone, Default)]
pub(in super::super) struct AppendScope {
    /// The function whose call waits for them.
    pub(in super::super) body: usize,
    /// The instruction that waits for them, and to which each goes back.
    pub(in super::super) back: u32,
    /// Variables that statements before made, behind those of the function.
    pub(in super::super) variables: Vec<String>,
    /// Functions and threads that statements before defined.
    pub(in super::super) functions: HashMap<String, usize>,
}

/// Appends statements and gives where they begin; with an error, code and scope are as they were.
pub(in super::super) fn append(
    code: &mut Code,
    at: &mut AppendScope,
    statements: &[ScriptStatement],
) -> Result<usize, ScriptError> {
    let mark = code.mark();
    let (mut compiler, own) = compiler(std::mem::take(code), at);
    let result = compiler.append(at, statements, own);
    *code = compiler.code;
    match result {
        Ok((entry, grown)) => {
            *at = grown;
            Ok(entry)
        }
        Err(error) => {
            code.cut(mark);
            Err(error)
        }
    }
}

/// A compiler that stands where the statements are to, and how many variables the function has of its own.
fn compiler(code: Code, at: &AppendScope) -> (Compiler, usize) {
    let globals = Names::of(code.globals.iter());
    let mut levels = Vec::new();
    let mut own = 0;
    let mut next = Some(at.body);
    // Every function stands behind the one around it.
    while let Some(body) = next.and_then(|number| code.bodies.get(number)) {
        let variables = if levels.is_empty() {
            own = body.variables.len();
            Names::of(body.variables.iter().chain(&at.variables))
        } else {
            Names::default()
        };
        levels.push(FunctionScope { variables, functions: body.functions.clone() });
        next = body.parent;
    }
    levels.reverse();
    levels.push(FunctionScope { functions: at.functions.clone(), ..FunctionScope::default() });
    let foreign = code.foreign.iter().enumerate().map(|(at, (name, _))| (name.clone(), at)).collect();
    (Compiler { code, globals, levels, loops: Vec::new(), foreign, interpreting: true }, own)
}

impl Compiler {
    fn append(
        &mut self,
        at: &AppendScope,
        statements: &[ScriptStatement],
        own: usize,
    ) -> Result<(usize, AppendScope), ScriptError> {
        let mut inside: Vec<&Function> = Vec::new();
        scope::functions(statements, &mut inside);
        let mut innermost = self.levels.pop().unwrap_or_default();
        // The variables of the function are those of its statements too.
        innermost.variables =
            self.levels.last_mut().map(|level| std::mem::take(&mut level.variables)).unwrap_or_default();
        self.no_new_globals(statements)?;
        scope::each(statements, &mut |statement| match &statement.what {
            Do::Return(_) => {
                Err(ScriptError::new(statement.position, "`return` outside a function of interpreter mode"))
            }
            Do::Assign { scope: Scope::Free | Scope::Local, name, indices, .. }
                if indices.is_empty() && self.globals.get(name).is_none() =>
            {
                innermost.variables.add(name, statement.position)
            }
            _ => Ok(()),
        })?;
        let numbers = self.declare(&inside, at.body, &mut innermost.functions, true)?;
        let (variables, functions) = (innermost.variables.order.clone(), innermost.functions.clone());
        self.levels.push(innermost);
        let entry = self.code.ops.len();
        self.body(statements)?;
        let position = statements.last().map(|last| last.position).unwrap_or_default();
        self.simple(Op::Jump(at.back), position);
        for (number, inner) in numbers.into_iter().zip(inside) {
            self.function(inner, number)?;
        }
        let variables = variables.get(own..).unwrap_or_default().to_vec();
        if variables.len() > limits::VARIABLES {
            return Err(ScriptError::more_than(position, limits::VARIABLES, "variables"));
        }
        Ok((entry, AppendScope { variables, functions, ..at.clone() }))
    }

    /// The manual: new globals cannot be declared in interpreter mode.
    fn no_new_globals(&self, statements: &[ScriptStatement]) -> Result<(), ScriptError> {
        scope::each(statements, &mut |statement| match &statement.what {
            Do::Assign { scope: Scope::Global, name, .. } if self.globals.get(name).is_none() => {
                let message = format!("the global variable {name} cannot be declared in interpreter mode");
                Err(ScriptError::new(statement.position, message))
            }
            Do::Define(function) => self.no_new_globals(&function.body),
            _ => Ok(()),
        })
    }
}
