//! Where in an image to hit, and with what: faults that the product has no switch for.
//!
//! Code is changed as worn-out flash memory would change it, except that here what it becomes is chosen.

use std::path::Path;

use object::{Object as _, ObjectSection as _, ObjectSymbol as _};

/// `b .`: the processor goes no further.
pub const HANG: [u16; 1] = [0xE7FE];

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

    /// Instructions which, put at `address`, panic there as `Option::unwrap` on nothing does.
    pub fn panic_at(&self, address: u64) -> Vec<u16> {
        let location = self.some_location();
        let panic = self.function(&["6option13unwrap_failed"]);
        let mut code = vec![];
        code.extend(move_immediate(0xF240, location & 0xFFFF));
        code.extend(move_immediate(0xF2C0, location >> 16));
        code.extend(branch(address + 2 * code.len() as u64, panic));
        code
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

/// `movw r0, #value` with the opcode 0xF240, `movt r0, #value` with 0xF2C0 (ARM DDI 0403, A7.7.76 and A7.7.79).
fn move_immediate(opcode: u16, value: u64) -> [u16; 2] {
    let value = value as u16;
    let first = opcode | (value >> 11 & 1) << 10 | value >> 12;
    [first, (value >> 8 & 7) << 12 | value & 0xFF]
}

/// `b.w` from one address to another (ARM DDI 0403, A7.7.12, encoding T4).
fn branch(from: u64, to: u64) -> [u16; 2] {
    let distance = (to as i64 - from as i64 - 4) as u32;
    let bit = |index: u32| (distance >> index & 1) as u16;
    let sign = bit(24);
    let j = |index: u32| u16::from(bit(index) == sign);
    let first = 0xF000 | sign << 10 | (distance >> 12 & 0x3FF) as u16;
    [first, 0x9000 | j(23) << 13 | j(22) << 11 | (distance >> 1 & 0x7FF) as u16]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As assembled by `llvm-mc -triple=thumbv7em`.
    #[test]
    fn instructions_are_encoded_as_an_assembler_does() {
        assert_eq!(move_immediate(0xF240, 0xABCD), [0xF64A, 0x30CD]);
        assert_eq!(move_immediate(0xF2C0, 0x0801), [0xF6C0, 0x0001]);
        assert_eq!(branch(0x1000, 0x1004), [0xF000, 0xB800]);
        assert_eq!(branch(0x1000, 0x0F00), [0xF7FF, 0xBF7E]);
        assert_eq!(branch(0x0800_0000, 0x0801_2346), [0xF012, 0xB9A1]);
    }
}
