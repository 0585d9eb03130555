//! What may be flashed: made-up ELF files, one fault at a time.

use std::fs;
use std::path::{Path, PathBuf};

use armid::firmware_image::{FirmwareImage, PARAMETER_FLASH, PROGRAM_FLASH, find_built};

/// A program for the board, as far as its file tells.
#[derive(Clone)]
struct Elf {
    class: u8,
    machine: u16,
    kind: u16,
    entry: u32,
    /// Address in flash and contents of each loaded segment.
    segments: Vec<(u32, Vec<u8>)>,
    symbols: Vec<(&'static str, u32)>,
}

impl Elf {
    /// With a stack at the end of core-coupled memory and code behind the vectors, as armid's are.
    fn sound() -> Self {
        let vectors: Vec<u8> = [0x1001_0000_u32, 0x0800_0009].iter().flat_map(|word| word.to_le_bytes()).collect();
        Self {
            class: 1,
            machine: 40,
            kind: 2,
            entry: 0x0800_0009,
            segments: vec![(PROGRAM_FLASH.start, vectors), (0x0800_0008, vec![0xBE; 100])],
            symbols: vec![("_parameters_start", PARAMETER_FLASH.start), ("_parameters_end", PARAMETER_FLASH.end)],
        }
    }

    fn with(change: impl FnOnce(&mut Self)) -> Self {
        let mut elf = Self::sound();
        change(&mut elf);
        elf
    }

    /// The file (System V ABI, chapter 4): header, program headers, contents, symbols, their names, section headers.
    fn bytes(&self) -> Vec<u8> {
        const HEADER: usize = 52;
        const PROGRAM_HEADER: usize = 32;
        let mut contents: Vec<u8> = Vec::new();
        let mut program_headers: Vec<u32> = Vec::new();
        let contents_at = HEADER + self.segments.len() * PROGRAM_HEADER;
        for (address, bytes) in &self.segments {
            let (offset, size) = ((contents_at + contents.len()) as u32, bytes.len() as u32);
            // Loaded; virtual and physical address the same; readable and executable.
            program_headers.extend([1, offset, *address, *address, size, size, 5, 4]);
            contents.extend(bytes);
        }
        let mut names = vec![0];
        let mut symbols: Vec<u32> = vec![0; 4];
        for (name, value) in &self.symbols {
            // Global, absolute.
            symbols.extend([names.len() as u32, *value, 0, 0xFFF1_0010]);
            names.extend(name.as_bytes());
            names.push(0);
        }
        let symbols_at = (contents_at + contents.len()) as u32;
        let symbols_size = 4 * symbols.len() as u32;
        let names_at = symbols_at + symbols_size;
        let sections_at = names_at + names.len() as u32;
        // None, the symbol table, and its names, which stand in for those of the sections.
        let mut sections: Vec<u32> = vec![0; 10];
        sections.extend([0, 2, 0, 0, symbols_at, symbols_size, 2, 1, 4, 16]);
        sections.extend([0, 3, 0, 0, names_at, names.len() as u32, 0, 0, 1, 0]);

        let mut file = vec![0x7F, b'E', b'L', b'F', self.class, 1, 1];
        file.resize(16, 0);
        let half = |file: &mut Vec<u8>, value: u16| file.extend(value.to_le_bytes());
        let word = |file: &mut Vec<u8>, value: u32| file.extend(value.to_le_bytes());
        half(&mut file, self.kind);
        half(&mut file, self.machine);
        [1, self.entry, HEADER as u32, sections_at, 0x0500_0400].into_iter().for_each(|value| word(&mut file, value));
        [HEADER as u16, PROGRAM_HEADER as u16, self.segments.len() as u16, 40, 3, 2]
            .into_iter()
            .for_each(|value| half(&mut file, value));
        program_headers.into_iter().for_each(|value| word(&mut file, value));
        file.extend(contents);
        symbols.into_iter().for_each(|value| word(&mut file, value));
        file.extend(names);
        sections.into_iter().for_each(|value| word(&mut file, value));
        file
    }
}

fn read(bytes: &[u8]) -> Result<FirmwareImage, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.elf");
    fs::write(&path, bytes).unwrap();
    FirmwareImage::read(&path).map_err(|error| error.to_string())
}

#[test]
fn a_sound_image_is_taken_with_what_goes_to_flash() {
    // Out of order, with initial values of variables behind and a segment that only reserves memory.
    let elf = Elf::with(|elf| elf.segments.reverse());
    let image = read(&elf.bytes()).unwrap();
    let places: Vec<(u32, usize)> =
        image.segments.iter().map(|segment| (segment.address, segment.bytes.len())).collect();
    assert_eq!(places, [(0x0800_0000, 8), (0x0800_0008, 100)]);
    assert_eq!(image.size(), 108);
    assert!(read(&Elf::with(|elf| elf.segments.push((0x2000_0000, Vec::new()))).bytes()).is_ok());
}

#[test]
fn everything_else_is_refused_and_named() {
    let refused = |bytes: &[u8], parts: &[&str]| {
        let told = read(bytes).unwrap_err();
        for part in parts {
            assert!(told.contains(part), "no {part:?} in: {told}");
        }
    };
    let sound = Elf::sound().bytes();
    refused(b"", &["no ELF file"]);
    refused(b":020000040800F2", &["no ELF file", ".hex"]);
    refused(&sound[..60], &["no ELF file"]);
    refused(&Elf::with(|elf| elf.class = 2).bytes(), &["no ELF file of a 32 bit processor"]);
    refused(&Elf::with(|elf| elf.machine = 243).bytes(), &["another processor", "machine 243", "is 40"]);
    refused(&Elf::with(|elf| elf.kind = 1).bytes(), &["no linked program", "type 1"]);
    refused(&Elf::with(|elf| elf.segments.clear()).bytes(), &["nothing to be flashed"]);
    let in_ram = Elf::with(|elf| elf.segments.push((0x2000_0000, vec![1; 4])));
    refused(&in_ram.bytes(), &["4 bytes at 0x20000000", "0x08000000 to 0x081fffff", "another chip"]);
    // The last byte before the parameters may be used, the next may not.
    let up_to = |end: u32| Elf::with(|elf| elf.segments.push((end - 4, vec![1; 4]))).bytes();
    assert!(read(&up_to(PARAMETER_FLASH.start)).is_ok());
    refused(&up_to(PARAMETER_FLASH.start + 1), &["reaches to 0x081c0001", "from 0x081c0000", "1792 KiB"]);
    refused(&up_to(PARAMETER_FLASH.end), &["reaches to 0x08200000"]);
    refused(&up_to(PARAMETER_FLASH.end + 1), &["another chip"]);
    refused(&Elf::with(|elf| elf.entry = 0x0800_0008).bytes(), &["no vector table", "entry 0x08000008"]);
    let stack = Elf::with(|elf| elf.segments[0].1[..4].copy_from_slice(&0x3000_0000_u32.to_le_bytes()));
    refused(&stack.bytes(), &["no vector table", "stack 0x30000000"]);
    let elsewhere = Elf::with(|elf| elf.segments[0].0 = 0x0800_4000);
    refused(&elsewhere.bytes(), &["no vector table at 0x08000000", "reset 0x00000000"]);
    refused(&Elf::with(|elf| elf.symbols.clear()).bytes(), &["not armid's", "_parameters_start is missing"]);
    let other = Elf::with(|elf| elf.symbols[0].1 = 0x081E_0000);
    refused(&other.bytes(), &["not armid's", "_parameters_start is 0x081e0000"]);
}

/// A folder as a build leaves it.
fn built(in_folder: &Path, image: &str) -> PathBuf {
    let path = in_folder.join(image).join("thumbv7em-none-eabihf/firmware/armid-firmware");
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(&path, Elf::sound().bytes()).unwrap();
    path
}

#[test]
fn the_image_built_here_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("host/src");
    fs::create_dir_all(&inside).unwrap();
    let told = find_built(&inside, None).unwrap_err().to_string();
    assert!(told.contains("tests/run firmware") && told.contains("debian-cross"), "{told}");
    // The debian-cross compiler's is as good; of two the newer is meant; CARGO_TARGET_DIR goes before both.
    let debian = built(folder.path(), "target/debian-cross");
    assert_eq!(find_built(&inside, None).unwrap(), debian);
    let rustup = built(folder.path(), "target");
    let age = |path: &Path, seconds: u64| {
        let file = fs::File::options().write(true).open(path).unwrap();
        file.set_modified(std::time::UNIX_EPOCH + std::time::Duration::from_secs(seconds)).unwrap();
    };
    age(&rustup, 2_000_000_000);
    age(&debian, 1_000_000_000);
    assert_eq!(find_built(&inside, None).unwrap(), rustup);
    age(&rustup, 500_000_000);
    assert_eq!(find_built(&inside, None).unwrap(), debian);
    assert!(find_built(folder.path(), Some(Path::new("elsewhere"))).is_err());
    let elsewhere = built(folder.path(), "elsewhere");
    assert_eq!(find_built(folder.path(), Some(Path::new("elsewhere"))).unwrap(), elsewhere);
}

#[cfg(feature = "flash")]
mod command {
    use std::process::Command;

    use tempfile::TempDir;

    use super::*;

    const BAD_FILE: i32 = 3;
    const UNREACHABLE: i32 = 4;

    /// Runs `armid flash` where nothing is built; gives exit code and stderr.
    fn flash(folder: &TempDir, arguments: &[&str]) -> (Option<i32>, String) {
        let output = Command::new(env!("CARGO_BIN_EXE_armid"))
            .arg("flash")
            .args(arguments)
            .current_dir(folder.path())
            .env_remove("CARGO_TARGET_DIR")
            .env_remove("ARMID_PROBE")
            .env_remove("ARMID_BOARD")
            .output()
            .unwrap();
        assert!(output.stdout.is_empty());
        (output.status.code(), String::from_utf8(output.stderr).unwrap())
    }

    #[test]
    fn a_bad_image_ends_the_command_before_a_probe_is_looked_for() {
        let folder = tempfile::tempdir().unwrap();
        let (code, told) = flash(&folder, &[]);
        assert_eq!(code, Some(BAD_FILE), "{told}");
        assert!(told.contains("tests/run firmware"), "{told}");
        fs::write(folder.path().join("bad.elf"), Elf::with(|elf| elf.machine = 243).bytes()).unwrap();
        let (code, told) = flash(&folder, &["bad.elf"]);
        assert_eq!(code, Some(BAD_FILE), "{told}");
        assert!(told.contains("bad.elf") && told.contains("another processor") && !told.contains("probe"), "{told}");
    }

    #[test]
    fn a_probe_that_is_not_there_is_named() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("good.elf"), Elf::sound().bytes()).unwrap();
        // No probe has this number, whatever is connected to this machine.
        let (code, told) = flash(&folder, &["good.elf", "--probe", "0483:374b:NO-SUCH-PROBE"]);
        assert_eq!(code, Some(UNREACHABLE), "{told}");
        assert!(told.contains("no debug probe 0483:374b:NO-SUCH-PROBE was found"), "{told}");
    }
    #[test]
    fn a_probe_that_nobody_serves_is_named_with_its_address() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("good.elf"), Elf::sound().bytes()).unwrap();
        // A port that was just free.
        let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let (code, told) = flash(&folder, &["good.elf", "--probe", &format!("1d50:6018:127.0.0.1:{port}")]);
        assert_eq!(code, Some(UNREACHABLE), "{told}");
        assert!(told.contains(&format!("answers at 1d50:6018:127.0.0.1:{port}; check its address")), "{told}");
    }
}
