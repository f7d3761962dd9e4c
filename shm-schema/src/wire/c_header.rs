//! The messages as a C header: what `wire!`, `wire_enum!` and `wire_flags!` declare, for C11 and C++17.
//!
//! Contract: made from the tables alone, so that it cannot differ from them; sizes and offsets are asserted
//! again by the C compiler.

use std::fmt::Write as _;

use super::foreign::{
    LAYOUT_HASH, MESSAGES, WireVariant, documentation, enumerations, flag_words, screaming, snake,
};
use super::layout::{Declaration, WireShape};

/// One number for the layout of every message in [`c_header`].
pub const C_LAYOUT_HASH: u64 = LAYOUT_HASH;

/// The messages that a program in C or C++ meets: enumerations, flags, structs and the layout hash.
#[must_use]
pub fn c_header() -> String {
    let mut header = HeaderText::default();
    header.text += HEAD;
    enumerations().iter().for_each(|(kind, variants)| header.enumeration(kind, variants));
    flag_words().iter().for_each(|(word, names)| header.flag_word(word, names));
    MESSAGES.iter().for_each(|shape| header.declare(shape));
    let _ = writeln!(header.text, "/** The layout of everything above, in one number. */");
    let _ = writeln!(header.text, "#define FORETRACE_LAYOUT_HASH UINT64_C(0x{C_LAYOUT_HASH:016x})\n");
    header.text += TAIL;
    header.text
}

const HEAD: &str = "\
/* Messages of foretrace. Made by `foretrace schema c`; do not edit. Lengths are metres, angles radians, times
 * nanoseconds of CLOCK_MONOTONIC. Enumerations and flags stand in fields of type uint32_t. */
#ifndef FORETRACE_MESSAGES_H
#define FORETRACE_MESSAGES_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern \"C\" {
#define FORETRACE_ASSERT(condition) static_assert(condition, #condition)
#else
#define FORETRACE_ASSERT(condition) _Static_assert(condition, #condition)
#endif

";

const TAIL: &str = "\
#ifdef __cplusplus
}
#endif

#endif
";

#[derive(Default)]
struct HeaderText {
    text: String,
    /// Structs that stand in it.
    declared: Vec<&'static str>,
}

impl HeaderText {
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
        let name = format!("foretrace_{}", snake(declaration.name));
        self.comment("", declaration.attributes);
        let _ = writeln!(self.text, "typedef struct {name} {{");
        for field in declaration.fields {
            self.comment("  ", field.attributes);
            let (c_type, lengths) = c_type(field.shape);
            let _ = writeln!(self.text, "  {c_type} {}{lengths};", field.name);
        }
        let _ = writeln!(self.text, "}} {name};");
        let _ = writeln!(self.text, "FORETRACE_ASSERT(sizeof({name}) == {});", declaration.size);
        for field in declaration.fields {
            let _ = writeln!(
                self.text,
                "FORETRACE_ASSERT(offsetof({name}, {}) == {});",
                field.name, field.offset
            );
        }
        self.text.push('\n');
    }

    fn comment(&mut self, indent: &str, attributes: &str) {
        let words = documentation(attributes);
        if !words.is_empty() {
            let _ = writeln!(self.text, "{indent}/** {words} */");
        }
    }

    /// An enumeration, and the words for its numbers.
    fn enumeration(&mut self, kind: &str, variants: &[WireVariant]) {
        let (name, prefix) = (format!("foretrace_{}", snake(kind)), screaming(kind));
        let _ = writeln!(self.text, "enum {name} {{");
        for (variant, number, label) in variants {
            let _ = writeln!(self.text, "  /** {label} */");
            let _ = writeln!(self.text, "  FORETRACE_{prefix}_{} = {number},", screaming(variant));
        }
        let _ = writeln!(self.text, "}};\n");
        let _ = writeln!(self.text, "static inline const char *{name}_label(int64_t number) {{");
        let _ = writeln!(self.text, "  switch (number) {{");
        for (_, number, label) in variants {
            let _ = writeln!(self.text, "  case {number}: return \"{label}\";");
        }
        let _ = writeln!(self.text, "  default: return \"unknown\";\n  }}\n}}\n");
    }

    fn flag_word(&mut self, word: &str, names: &[(&str, u32)]) {
        let prefix = word.strip_suffix("_flags").unwrap_or(word).to_uppercase();
        let _ = writeln!(self.text, "/* foretrace_{word} */");
        // An enumerator of C is an int, which has no bit 31.
        for (name, bit) in names {
            let _ = writeln!(self.text, "#define FORETRACE_{prefix}_{name} UINT32_C(0x{bit:x})");
        }
        self.text.push('\n');
    }
}

/// The type of a field, and the lengths behind its name.
fn c_type(shape: &WireShape) -> (String, String) {
    match shape {
        WireShape::Number("f32") => ("float".to_owned(), String::new()),
        WireShape::Number("f64") => ("double".to_owned(), String::new()),
        WireShape::Number(integer) => {
            let sign = if integer.starts_with('u') { "u" } else { "" };
            (format!("{sign}int{}_t", integer.trim_start_matches(['u', 'i'])), String::new())
        }
        WireShape::Array(of, length) => {
            let (c_type, inner) = c_type(of);
            (c_type, format!("[{length}]{inner}"))
        }
        WireShape::Struct(declaration) => (format!("foretrace_{}", snake(declaration.name)), String::new()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PenSample;
    use crate::wire::layout::Wire;

    #[test]
    fn shapes_of_rust_become_types_of_c() {
        let nested = <[[f32; 3]; 2]>::SHAPE;
        assert_eq!(c_type(&nested), ("float".to_owned(), "[2][3]".to_owned()));
        assert_eq!(c_type(&WireShape::Number("i16")).0, "int16_t");
    }

    #[test]
    fn each_message_stands_after_what_it_holds_and_once() {
        let header = c_header();
        let at = |text: &str| header.find(text).unwrap_or_else(|| panic!("{text}"));
        assert!(at("} foretrace_header;") < at("typedef struct foretrace_pen_sample {"));
        assert!(at("} foretrace_percentiles;") < at("typedef struct foretrace_status {"));
        assert_eq!(header.matches("typedef struct foretrace_header {").count(), 1);
        let sample = format!("FORETRACE_ASSERT(sizeof(foretrace_pen_sample) == {});", size_of::<PenSample>());
        assert!(header.contains(&sample), "{sample}");
        assert!(header.contains("  /** Position [m]. */\n  double x_m;"));
        assert!(
            header.contains("FORETRACE_MODE_HOMING = 6,")
                && header.contains("FORETRACE_PEN_CONTACT UINT32_C(0x1)")
        );
    }

    #[test]
    fn no_field_is_a_word_of_c_or_cpp() {
        const WORDS: [&str; 14] = [
            "new", "delete", "class", "this", "default", "case", "switch", "register", "operator", "private",
            "union", "template", "auto", "int",
        ];
        let header = c_header();
        for word in WORDS {
            assert!(!header.contains(&format!(" {word};")), "{word}");
        }
    }
}
