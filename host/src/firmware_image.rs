//! The image for the board: finding the one built here, and making sure that a file is one, before anything is erased.

use std::ops::Range;
use std::path::{Path, PathBuf};

use object::read::elf::{ElfFile32, FileHeader as _, ProgramHeader as _};
use object::{LittleEndian, Object as _, ObjectSymbol as _, elf};

/// Flash that holds the program (the `FLASH` of `memory.x`).
pub const PROGRAM_FLASH: Range<u32> = 0x0800_0000..0x081C_0000;
/// The last two sectors of flash, which hold the stored parameters (the `PARAMETERS` of `memory.x`).
pub const PARAMETER_FLASH: Range<u32> = 0x081C_0000..0x0820_0000;
/// Where the stack may begin: just above core-coupled memory or SRAM (RM0090, memory map), or inside.
const STACK_MEMORY: [Range<u32>; 2] = [0x1000_0000..0x1001_0000, 0x2000_0000..0x2003_0000];

/// Where the build puts the image, below a target folder.
const BUILT_BELOW: &str = "thumbv7em-none-eabihf/firmware/armid-firmware";
/// Folders below the target folder with a target folder of their own: none, and that of Debian's compiler.
const TARGET_FOLDERS: [&str; 2] = ["", "debian-cross"];

/// Symbols of armid's memory map, by which its images are told from others.
const PARAMETER_SYMBOLS: [&str; 2] = ["_parameters_start", "_parameters_end"];

/// An image that may be flashed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FirmwareImage {
    /// The file.
    pub path: PathBuf,
    /// What goes where in flash, by address; all of it inside [`PROGRAM_FLASH`].
    pub segments: Vec<Segment>,
}

/// Bytes that stand together in flash.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Segment {
    /// Address of the first.
    pub address: u32,
    /// The bytes.
    pub bytes: Vec<u8>,
}

/// Why there is no image, or a file is none.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// None was named and none is built.
    #[error(
        "no firmware image was built here (looked for {}); build one with `tests/run firmware`, or name its ELF file",
        looked_for.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
    )]
    NoneBuilt {
        /// Where one would be.
        looked_for: Vec<PathBuf>,
    },
    /// The file cannot be used.
    #[error("{}: {problem}", path.display())]
    Unusable {
        /// The file.
        path: PathBuf,
        /// Why not.
        problem: ImageProblem,
    },
}

/// What is wrong with a file that should be an image.
#[derive(Debug, thiserror::Error)]
pub enum ImageProblem {
    /// It cannot be read.
    #[error("cannot be read: {0}; check the path")]
    Read(std::io::Error),
    /// It is no ELF file of 32 bits.
    #[error(
        "is no ELF file of a 32 bit processor ({0}); give the file that the firmware build left, not a .bin or .hex"
    )]
    NotElf(String),
    /// It is for another processor.
    #[error(
        "is a program for another processor (ELF machine {machine}, but an ARM core is {}); give the board's image",
        elf::EM_ARM
    )]
    WrongMachine {
        /// Its machine.
        machine: u16,
    },
    /// It is an object file or a library.
    #[error("is no linked program (ELF type {kind}, but a program is {}); link it first", elf::ET_EXEC)]
    NotProgram {
        /// Its type.
        kind: u16,
    },
    /// There is nothing in it.
    #[error("holds nothing to be flashed; it was not linked with armid's memory.x")]
    Empty,
    /// Something of it lies outside flash.
    #[error(
        "puts {size} bytes at {address:#010x}, but flash is {:#010x} to {:#010x}; it was linked for another chip",
        PROGRAM_FLASH.start, PARAMETER_FLASH.end - 1
    )]
    OutsideFlash {
        /// Where.
        address: u32,
        /// How much.
        size: usize,
    },
    /// Something of it lies where the parameters are stored.
    #[error(
        "reaches to {end:#010x}, but from {:#010x} on flash is reserved for the stored parameters; make the program \
         smaller than {} KiB", PARAMETER_FLASH.start, PROGRAM_FLASH.len() / 1024
    )]
    OverParameters {
        /// Just behind its end.
        end: u32,
    },
    /// The chip would not find its start.
    #[error(
        "has no vector table at {:#010x} (stack {stack:#010x}, reset {reset:#010x}, entry {entry:#010x}); it was not \
         linked with armid's memory.x", PROGRAM_FLASH.start
    )]
    NoVectors {
        /// First word of flash.
        stack: u32,
        /// Second word of flash.
        reset: u32,
        /// Entry point of the file.
        entry: u32,
    },
    /// It is a program for this chip, but another one.
    #[error(
        "is a program for this chip, but not armid's: it does not reserve {:#010x} to {:#010x} for the stored parameters \
         ({} is {})", PARAMETER_FLASH.start, PARAMETER_FLASH.end, PARAMETER_SYMBOLS[0],
        found.map_or("missing".into(), |address| format!("{address:#010x}"))
    )]
    NotArmid {
        /// What it reserves.
        found: Option<u64>,
    },
}

impl FirmwareImage {
    /// Reads the image at `path` and checks that it is one of armid's.
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        let unusable = |problem| ImageError::Unusable { path: path.into(), problem };
        let bytes = std::fs::read(path).map_err(|error| unusable(ImageProblem::Read(error)))?;
        let segments = segments(&bytes).map_err(unusable)?;
        Ok(Self { path: path.into(), segments })
    }

    /// Bytes it takes in flash.
    pub fn size(&self) -> usize {
        self.segments.iter().map(|segment| segment.bytes.len()).sum()
    }
}

/// The image built last, below `target` (what `CARGO_TARGET_DIR` says) or else below the folder `target` of `from` or
/// one of the folders around it.
pub fn find_built(from: &Path, target: Option<&Path>) -> Result<PathBuf, ImageError> {
    let targets: Vec<PathBuf> = match target {
        Some(target) => vec![from.join(target)],
        None => from.ancestors().map(|folder| folder.join("target")).collect(),
    };
    for target in &targets {
        let built = |below: &&str| {
            let path = target.join(below).join(BUILT_BELOW);
            let when = path.metadata().and_then(|metadata| metadata.modified()).ok()?;
            Some((when, path))
        };
        if let Some((_, path)) = TARGET_FOLDERS.iter().filter_map(built).max() {
            return Ok(path);
        }
    }
    let nearest = targets.first().into_iter();
    let looked_for = nearest.flat_map(|target| TARGET_FOLDERS.map(|below| target.join(below).join(BUILT_BELOW)));
    Err(ImageError::NoneBuilt { looked_for: looked_for.collect() })
}

fn segments(bytes: &[u8]) -> Result<Vec<Segment>, ImageProblem> {
    let file = ElfFile32::<LittleEndian>::parse(bytes).map_err(|error| ImageProblem::NotElf(error.to_string()))?;
    let header = file.elf_header();
    let machine = header.e_machine(LittleEndian);
    if machine != elf::EM_ARM {
        return Err(ImageProblem::WrongMachine { machine });
    }
    let kind = header.e_type(LittleEndian);
    if kind != elf::ET_EXEC {
        return Err(ImageProblem::NotProgram { kind });
    }
    let mut segments = Vec::new();
    for program_header in file.elf_program_headers() {
        if program_header.p_type(LittleEndian) != elf::PT_LOAD || program_header.p_filesz(LittleEndian) == 0 {
            continue;
        }
        // Initial values of variables are loaded to flash, their physical address, and copied to RAM at the start.
        let address = program_header.p_paddr(LittleEndian);
        let data = program_header.data(LittleEndian, bytes);
        let data = data.map_err(|()| ImageProblem::NotElf("a segment lies outside the file".into()))?;
        segments.push(Segment { address, bytes: data.to_vec() });
    }
    segments.sort_by_key(|segment: &Segment| segment.address);
    check_addresses(&segments)?;
    check_vectors(&segments, header.e_entry(LittleEndian))?;
    let reserved = PARAMETER_SYMBOLS.map(|name| file.symbols().find(|symbol| symbol.name() == Ok(name)));
    let reserved = reserved.map(|symbol| symbol.map(|symbol| symbol.address()));
    if reserved != [PARAMETER_FLASH.start, PARAMETER_FLASH.end].map(|address| Some(u64::from(address))) {
        return Err(ImageProblem::NotArmid { found: reserved[0] });
    }
    Ok(segments)
}

fn check_addresses(segments: &[Segment]) -> Result<(), ImageProblem> {
    if segments.is_empty() {
        return Err(ImageProblem::Empty);
    }
    for Segment { address, bytes } in segments {
        let end = u64::from(*address) + bytes.len() as u64;
        if *address < PROGRAM_FLASH.start || end > u64::from(PARAMETER_FLASH.end) {
            return Err(ImageProblem::OutsideFlash { address: *address, size: bytes.len() });
        }
        if end > u64::from(PROGRAM_FLASH.end) {
            return Err(ImageProblem::OverParameters { end: end as u32 });
        }
    }
    Ok(())
}

/// The chip takes its stack and its start from the first two words of flash.
fn check_vectors(segments: &[Segment], entry: u32) -> Result<(), ImageProblem> {
    let first = segments.iter().find(|segment| segment.address == PROGRAM_FLASH.start);
    let word = |index: usize| {
        let bytes = first.and_then(|segment| segment.bytes.get(4 * index..4 * index + 4));
        bytes.and_then(|bytes| bytes.try_into().ok()).map_or(0, u32::from_le_bytes)
    };
    let (stack, reset) = (word(0), word(1));
    let stack_is_in_memory = STACK_MEMORY.iter().any(|memory| memory.start < stack && stack <= memory.end);
    // Bit 0 says that the code is Thumb, the only kind this core has.
    let starts_in_flash = |address: u32| address & 1 == 1 && PROGRAM_FLASH.contains(&address);
    if stack_is_in_memory && starts_in_flash(reset) && starts_in_flash(entry) {
        Ok(())
    } else {
        Err(ImageProblem::NoVectors { stack, reset, entry })
    }
}
