//! Where in an image to hit, and with what: faults that the product has no switch for.
//!
//! The program is led astray through its memory: a task's state names the function that goes on with it, and that name
//! is changed to code put where the end of a long recording would be.

use std::path::Path;

use object::{Object as _, ObjectSection as _, ObjectSymbol as _};

/// An ELF file, to find places in.
pub struct ImageMap {
    bytes: Vec<u8>,
}

/// A static variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Variable {
    /// Where it begins.
    pub address: u64,
    /// Its size in bytes.
    pub size: u64,
}

impl ImageMap {
    /// Reads the file at `path`. Panics where it is none.
    pub fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        Self { bytes }
    }

    fn file(&self) -> object::File<'_> {
        object::File::parse(&self.bytes[..]).expect("an ELF file")
    }

    /// The one symbol whose mangled name contains all of `parts`. Panics unless there is exactly one.
    fn symbol(&self, parts: &[&str]) -> Variable {
        let file = self.file();
        let found: Vec<(Variable, String)> = file
            .symbols()
            .filter(|symbol| symbol.size() > 0)
            .filter_map(|symbol| {
                let name = symbol.name().ok()?;
                let all = parts.iter().all(|part| name.contains(part));
                all.then(|| (Variable { address: symbol.address(), size: symbol.size() }, name.to_owned()))
            })
            .collect();
        let [(variable, _)] = &found[..] else { panic!("not one symbol with {parts:?}, but {found:?}") };
        *variable
    }

    /// A static variable by parts of its name.
    pub fn variable(&self, parts: &[&str]) -> Variable {
        self.symbol(parts)
    }

    /// The first instruction of a function by parts of its name.
    pub fn function(&self, parts: &[&str]) -> u64 {
        // The lowest bit of a function's symbol says Thumb.
        self.symbol(parts).address & !1
    }

    /// All functions that go on with a task: the name of one of them is in each task's state.
    pub fn task_functions(&self) -> Vec<u64> {
        let is_one = |name: &str| name.contains("TaskStorage") && name.contains("4poll");
        let file = self.file();
        let symbols = file.symbols().filter(|symbol| symbol.name().is_ok_and(is_one));
        symbols.map(|symbol| symbol.address() | 1).collect()
    }

    /// Code that panics as `Option::unwrap` on nothing does.
    pub fn panic(&self) -> Vec<u16> {
        let function = self.function(&["6option13unwrap_failed"]);
        [&load(0, self.some_location())[..], &go_to(function)].concat()
    }

    /// Any source location the image has for its own panics: a pointer to a file name, its length, line and column.
    fn some_location(&self) -> u64 {
        let file = self.file();
        let section = file.section_by_name(".rodata").expect("read-only data");
        let (base, data) = (section.address(), section.data().expect("read-only data"));
        let word = |offset: usize| {
            data.get(offset..offset + 4).map(|bytes| u32::from_le_bytes(bytes.try_into().expect("four bytes")))
        };
        let is_location = |offset: &usize| {
            let fields = [0, 4, 8, 12].map(|field| word(offset + field).unwrap_or(0));
            let [name, length, line, column] = fields.map(u64::from);
            let start = usize::try_from(name.wrapping_sub(base)).unwrap_or(usize::MAX);
            let name = start.checked_add(length as usize).and_then(|end| data.get(start..end));
            name.is_some_and(|name| name.ends_with(b".rs")) && (1..10_000).contains(&line) && (1..200).contains(&column)
        };
        let offset = (0..data.len()).step_by(4).find(is_location).expect("a source location");
        base + offset as u64
    }
}

/// Code that goes no further: `b .`.
pub const HANG: [u16; 1] = [0xE7FE];

/// Code that replaces the vector table by the one at `table`, and goes on with the function at `then`.
pub fn switch_vector_table(table: u64, then: u64) -> Vec<u16> {
    /// The vector table offset register (ARM DDI 0403, B3.2.5).
    const VECTOR_TABLE_OFFSET: u64 = 0xE000_ED08;
    const STORE_R2_AT_R1: [u16; 1] = [0x600A];
    [&load(1, VECTOR_TABLE_OFFSET)[..], &load(2, table), &STORE_R2_AT_R1, &go_to(then)].concat()
}

/// `movw` and `movt`, which load `value` into a register (ARM DDI 0403, A7.7.76 and A7.7.79).
fn load(register: u16, value: u64) -> [u16; 4] {
    let half = |opcode: u16, half: u16| {
        let first = opcode | (((half >> 11) & 1) << 10) | (half >> 12);
        [first, (((half >> 8) & 7) << 12) | (register << 8) | (half & 0xFF)]
    };
    let [low, high] = [half(0xF240, value as u16), half(0xF2C0, (value >> 16) as u16)];
    [low[0], low[1], high[0], high[1]]
}

/// Goes on with the Thumb code at an address: `bx r3`.
fn go_to(address: u64) -> [u16; 5] {
    let [a, b, c, d] = load(3, address | 1);
    [a, b, c, d, 0x4718]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As assembled by `llvm-mc -triple=thumbv7em`.
    #[test]
    fn instructions_are_encoded_as_an_assembler_does() {
        assert_eq!(load(0, 0x0801_ABCD), [0xF64A, 0x30CD, 0xF6C0, 0x0001]);
        assert_eq!(load(3, 0x2000_0D08), [0xF640, 0x5308, 0xF2C2, 0x0300]);
        assert_eq!(go_to(0x2000_0D08), [0xF640, 0x5309, 0xF2C2, 0x0300, 0x4718]);
    }
}
