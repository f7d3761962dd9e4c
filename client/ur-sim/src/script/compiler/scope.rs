//! Which variable a name means. Decided before the program runs, by the manual's rules of scoping (5.25,
//! "Scoping rules"): what the program itself assigns to is global, whatever it is called there; in a function
//! a name is the function's own where it is a parameter or `local`, else the global of that name, else the
//! function's own. The locals of a function are not seen by the functions inside it.

use super::super::code::Where;
use super::super::error::{ScriptError, ScriptPosition};
use super::super::limits;
use super::super::tree::{Do, Function, Scope, ScriptStatement};
use std::collections::HashMap;

/// Names with the numbers of their variables.
#[derive(Debug, Default)]
pub(super) struct Names {
    numbers: HashMap<String, u16>,
    pub(super) order: Vec<String>,
}

impl Names {
    pub(super) fn get(&self, name: &str) -> Option<u16> {
        self.numbers.get(name).copied()
    }

    /// Names that were within the bounds when they were added.
    pub(super) fn of<'a>(names: impl Iterator<Item = &'a String>) -> Self {
        let order: Vec<String> = names.cloned().collect();
        Self { numbers: order.iter().cloned().zip(0..).collect(), order }
    }

    pub(super) fn add(&mut self, name: &str, position: ScriptPosition) -> Result<(), ScriptError> {
        if self.numbers.contains_key(name) {
            return Ok(());
        }
        let number = u16::try_from(self.order.len()).unwrap_or(u16::MAX);
        if self.order.len() >= limits::VARIABLES {
            return Err(ScriptError::more_than(position, limits::VARIABLES, "variables in one function"));
        }
        self.numbers.insert(name.to_owned(), number);
        self.order.push(name.to_owned());
        Ok(())
    }
}

/// What the compiler knows of the function that it is in, and of those around it.
#[derive(Debug, Default)]
pub(super) struct FunctionScope {
    pub(super) variables: Names,
    /// Functions that stand in it.
    pub(super) functions: HashMap<String, usize>,
}

/// Calls `found` with every statement of a body, those of blocks included, those of functions inside not.
pub(super) fn each<E>(
    body: &[ScriptStatement],
    found: &mut impl FnMut(&ScriptStatement) -> Result<(), E>,
) -> Result<(), E> {
    for statement in body {
        found(statement)?;
        match &statement.what {
            Do::If { arms, otherwise } => {
                for (_, arm) in arms {
                    each(arm, found)?;
                }
                each(otherwise, found)?;
            }
            Do::While(_, body) => each(body, found)?,
            _ => {}
        }
    }
    Ok(())
}

/// Every global of the program: what it assigns to itself, and what is declared `global` anywhere.
pub(super) fn globals(program: &[ScriptStatement], names: &mut Names) -> Result<(), ScriptError> {
    each(program, &mut |statement| match &statement.what {
        Do::Assign { name, indices, .. } if indices.is_empty() => names.add(name, statement.position),
        Do::Define(function) => declared_global(&function.body, names),
        _ => Ok(()),
    })
}

fn declared_global(body: &[ScriptStatement], names: &mut Names) -> Result<(), ScriptError> {
    each(body, &mut |statement| match &statement.what {
        Do::Assign { scope: Scope::Global, name, .. } => names.add(name, statement.position),
        Do::Define(function) => declared_global(&function.body, names),
        _ => Ok(()),
    })
}

/// The variables that `function` has of its own; the program has none.
pub(super) fn variables(
    function: &Function,
    is_program: bool,
    globals: &Names,
) -> Result<Names, ScriptError> {
    let mut own = Names::default();
    if is_program {
        return Ok(own);
    }
    for (parameter, _) in &function.parameters {
        own.add(parameter, function.position)?;
    }
    each(&function.body, &mut |statement| match &statement.what {
        Do::Assign { scope: Scope::Local, name, .. } => own.add(name, statement.position),
        Do::Assign { scope: Scope::Free, name, indices, .. }
            if indices.is_empty() && globals.get(name).is_none() =>
        {
            own.add(name, statement.position)
        }
        _ => Ok(()),
    })?;
    Ok(own)
}

/// The functions that stand in `body`, numbered from `next` on in the order of the text.
pub(super) fn functions<'a>(body: &'a [ScriptStatement], found: &mut Vec<&'a Function>) {
    for statement in body {
        match &statement.what {
            Do::Define(function) => found.push(function),
            Do::If { arms, otherwise } => {
                for (_, arm) in arms {
                    functions(arm, found);
                }
                functions(otherwise, found);
            }
            Do::While(_, body) => functions(body, found),
            _ => {}
        }
    }
}

/// The variable that `name` means where a function has these variables of its own.
pub(super) fn find(name: &str, own: Option<&Names>, globals: &Names) -> Option<Where> {
    let local = own.and_then(|own| own.get(name)).map(Where::Local);
    local.or_else(|| globals.get(name).map(Where::Global))
}
