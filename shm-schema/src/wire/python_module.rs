//! The messages as a Python module: what `wire!`, `wire_enum!` and `wire_flags!` declare, for Python 3.10 and
//! later, with or without numpy.
//!
//! Contract: made from the tables alone. A message is a `ctypes` structure: fields are attributes, its bytes
//! are those on the wire, and numpy makes its dtype of it.

use std::fmt::Write as _;

use super::foreign::{
    LAYOUT_HASH, MESSAGES, WireVariant, doc_lines, documentation, enumerations, flag_words, screaming,
};
use super::layout::{Declaration, WireShape};

/// The messages that a program in Python meets: enumerations, flags, records and the layout hash.
#[must_use]
pub fn python_module() -> String {
    let mut module = ModuleText { text: HEAD.to_owned(), ..ModuleText::default() };
    for (kind, variants) in enumerations() {
        module.enumeration(kind, &variants);
        module.kinds.push((kind.to_owned(), kind.to_owned()));
    }
    for (word, names) in flag_words() {
        module.flag_word(word, names);
        module.kinds.push((word.to_owned(), camel(word)));
    }
    MESSAGES.iter().for_each(|shape| module.declare(shape));
    module.text += "#: The layout of everything above, in one number.\n";
    let _ = writeln!(module.text, "LAYOUT_HASH = 0x{LAYOUT_HASH:016x}");
    module.text
}

const HEAD: &str = include_str!("python_module_head.py");

#[derive(Default)]
struct ModuleText {
    text: String,
    /// Structs that stand in it.
    declared: Vec<&'static str>,
    /// Enumerations and flag words: name in the source, name of the class.
    kinds: Vec<(String, String)>,
}

impl ModuleText {
    fn enumeration(&mut self, kind: &str, variants: &[WireVariant]) {
        let _ = writeln!(self.text, "class {kind}(Enumeration):");
        for (variant, number, label) in variants {
            let _ = writeln!(self.text, "    {} = {number}, \"{label}\"", screaming(variant));
        }
        self.text.push_str("\n\n");
    }

    fn flag_word(&mut self, word: &str, names: &[(&str, u32)]) {
        let _ = writeln!(self.text, "class {}(enum.IntFlag):", camel(word));
        for (name, bit) in names {
            let _ = writeln!(self.text, "    {name} = 0x{bit:x}");
        }
        self.text.push_str("\n\n");
    }

    /// A struct, after those inside it.
    fn declare(&mut self, shape: &WireShape) {
        match shape {
            WireShape::Number(_) => {}
            WireShape::Array(of, _) => self.declare(of),
            WireShape::Struct(declaration) if self.declared.contains(&declaration.name) => {}
            WireShape::Struct(declaration) => {
                self.declared.push(declaration.name);
                declaration.fields.iter().for_each(|field| self.declare(field.shape));
                self.write_struct(declaration);
            }
        }
    }

    fn write_struct(&mut self, declaration: &Declaration) {
        let _ = writeln!(self.text, "class {}(Record):", declaration.name);
        let _ = writeln!(self.text, "    \"\"\"{}\"\"\"\n", text(declaration.attributes));
        for field in declaration.fields {
            let words = text(field.attributes);
            if !words.is_empty() {
                let _ = writeln!(self.text, "    #: {words}");
            }
            let _ = writeln!(self.text, "    {}: {}", field.name, annotation(field.shape));
        }
        let kinds: Vec<String> = declaration
            .fields
            .iter()
            .filter_map(|field| Some(format!("\"{}\": {}", field.name, self.kind(field.attributes)?)))
            .collect();
        if !kinds.is_empty() {
            let _ = writeln!(self.text, "    _kinds_ = {{{}}}", kinds.join(", "));
        }
        let _ = writeln!(self.text, "    _fields_ = [");
        for field in declaration.fields {
            let _ = writeln!(self.text, "        (\"{}\", {}),", field.name, ctypes(field.shape));
        }
        let _ = writeln!(self.text, "    ]\n\n\n_check({}, {})\n\n", declaration.name, declaration.size);
    }

    /// The class behind a field whose documentation begins with a link to an enumeration or a flag word.
    fn kind(&self, attributes: &str) -> Option<&str> {
        let lines = doc_lines(attributes);
        let link = lines.first()?.strip_prefix("[`")?.split('`').next()?;
        let name = link.trim_start_matches("mod@").trim_start_matches("crate::");
        self.kinds.iter().find(|(source, _)| source == name).map(|(_, class)| class.as_str())
    }
}

/// `foo_bar` as `FooBar`.
fn camel(name: &str) -> String {
    let word = |word: &str| {
        let mut letters = word.chars();
        letters.next().into_iter().flat_map(char::to_uppercase).chain(letters).collect::<String>()
    };
    name.split('_').map(word).collect()
}

/// Documentation, safe inside a docstring and behind a comment sign.
fn text(attributes: &str) -> String {
    documentation(attributes).replace('\\', "/").replace('"', "'")
}

/// The type of a field as `ctypes` has it. Bytes are texts, padded with NUL.
fn ctypes(shape: &WireShape) -> String {
    match shape {
        WireShape::Number("f32") => "ctypes.c_float".to_owned(),
        WireShape::Number("f64") => "ctypes.c_double".to_owned(),
        WireShape::Number(integer) => {
            let sign = if integer.starts_with('u') { "u" } else { "" };
            format!("ctypes.c_{sign}int{}", integer.trim_start_matches(['u', 'i']))
        }
        WireShape::Array(WireShape::Number("u8"), length) => format!("ctypes.c_char * {length}"),
        WireShape::Array(of @ WireShape::Array(..), length) => format!("({}) * {length}", ctypes(of)),
        WireShape::Array(of, length) => format!("{} * {length}", ctypes(of)),
        WireShape::Struct(declaration) => declaration.name.to_owned(),
    }
}

/// The type of a field as a reader of the attribute sees it.
fn annotation(shape: &WireShape) -> String {
    match shape {
        WireShape::Number("f32" | "f64") => "float".to_owned(),
        WireShape::Number(_) => "int".to_owned(),
        WireShape::Array(WireShape::Number("u8"), _) => "builtins.bytes".to_owned(),
        WireShape::Array(of @ WireShape::Array(..), _) => format!("ctypes.Array[{}]", annotation(of)),
        WireShape::Array(of, _) => format!("ctypes.Array[{}]", ctypes(of)),
        WireShape::Struct(declaration) => declaration.name.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::layout::Wire;

    #[test]
    fn shapes_become_types_of_ctypes() {
        assert_eq!(ctypes(&<[[f32; 3]; 2]>::SHAPE), "(ctypes.c_float * 3) * 2");
        assert_eq!(ctypes(&WireShape::Number("i16")), "ctypes.c_int16");
        assert_eq!(ctypes(&<[u8; 5]>::SHAPE), "ctypes.c_char * 5");
        assert_eq!(annotation(&<[u8; 5]>::SHAPE), "builtins.bytes");
        assert_eq!(annotation(&<[[f32; 3]; 2]>::SHAPE), "ctypes.Array[ctypes.Array[ctypes.c_float]]");
        assert_eq!(camel("missing_rights"), "MissingRights");
    }

    #[test]
    fn fields_know_their_enumerations_and_no_name_is_a_word_of_python() {
        let module = python_module();
        for wanted in [
            "    _kinds_ = {\"mode\": Mode, \"flags\": CommandFlags}",
            "    FOLLOWING = 2, \"following\"",
            "    CONTACT = 0x1",
            "    #: Position [m].\n    x_m: float",
            "_check(PenSample, ",
        ] {
            assert!(module.contains(wanted), "{wanted}");
        }
        for word in ["from", "in", "is", "lambda", "pass", "def", "class", "global", "None", "True", "async"]
        {
            assert!(!module.contains(&format!("\n    {word}: ")), "{word}");
            assert!(!module.contains(&format!("\n    {word} = ")), "{word}");
        }
    }

    /// The documentation that `stringify!` gives is whole: none is dropped where it breaks a line.
    #[test]
    fn every_record_and_field_has_all_its_documentation() {
        fn judge(shape: &WireShape, module: &str, fields: &mut usize) {
            match shape {
                WireShape::Number(_) => {}
                WireShape::Array(of, _) => judge(of, module, fields),
                WireShape::Struct(declaration) => {
                    let class = format!("\nclass {}(Record):\n", declaration.name);
                    let (_, body) = module.split_once(&class).expect(declaration.name);
                    let body = body.split("_fields_").next().expect("before the fields");
                    assert_eq!(last_word(declaration.attributes), last(body.lines().next()), "{class}");
                    for field in declaration.fields {
                        let line = format!("\n    {}: ", field.name);
                        let (before, _) = body.split_once(&line).expect(field.name);
                        let told = before.lines().last();
                        let place = format!("{}.{}", declaration.name, field.name);
                        assert!(told.is_some_and(|told| told.starts_with("    #: ")), "{place}: {told:?}");
                        assert_eq!(last_word(field.attributes), last(told), "{place}");
                        judge(field.shape, module, fields);
                        *fields += 1;
                    }
                }
            }
        }
        // Independent of the reader of literals: the last quote of the last attribute that documents.
        fn last_word(attributes: &str) -> String {
            let last = attributes.rfind("doc =").and_then(|at| attributes.get(at..)).unwrap_or_default();
            let end = last.rfind('"').unwrap_or_default();
            let begin = last.find('"').map_or(0, |at| at + 1);
            letters(last.get(begin..end).unwrap_or_default().split_whitespace().last().unwrap_or_default())
        }
        fn last(line: Option<&str>) -> String {
            letters(line.unwrap_or_default().split_whitespace().last().unwrap_or_default())
        }
        fn letters(word: &str) -> String {
            word.replace("mod@", "").chars().filter(|letter| letter.is_alphanumeric()).collect()
        }
        let module = python_module();
        assert!(!module.contains("\"\"\"\"\"\""), "a record without words");
        let mut fields = 0;
        MESSAGES.iter().for_each(|shape| judge(shape, &module, &mut fields));
        assert!(fields > 250, "{fields}");
    }

    /// Made by `foretrace schema python`; `FORETRACE_BLESS=1` writes it anew.
    #[test]
    fn the_module_of_the_python_package_is_that_of_the_tables() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../client/python/python/foretrace/messages.py");
        let now = python_module();
        if std::env::var_os("FORETRACE_BLESS").is_some() {
            std::fs::write(path, &now).unwrap();
        }
        let same = std::fs::read_to_string(path).unwrap_or_default() == now;
        assert!(
            same,
            "messages.py is of other messages: FORETRACE_BLESS=1 cargo test -p foretrace-shm --lib"
        );
    }
}
