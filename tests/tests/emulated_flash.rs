//! `armid flash` with a debug probe on the emulated chip: the command, the library behind it and its code for erasing and
//! programming, which runs on the emulated core, are those of a real board. The probe and what it is wired to are models.
//!
//! `tests/run emulated` names the image and the command; without them this passes without having shown anything, and
//! says so.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

use armid::client::Client;
use armid::firmware_image::{FirmwareImage, PARAMETER_FLASH};
use armid::link::MemoryFlash;
use armid_tests::emulated_board::flash::FlashOperation;
use armid_tests::emulated_board::observations::{FlashUse, OutputChange};
use armid_tests::emulated_board::{EmulatedBoard, image_and_command_from_environment};
use armid_tests::scenarios::{hidden, nod, prepared, robot, true_model};
use rigless::soc::Width;
use shared::protocol::{ControlLaw, Request};

/// What a board's program calls the board, and another program something as long.
const BOARD: &str = "nucleo-f429zi";
const OTHER_BOARD: &str = "another-board";

/// A board has started by then.
const STARTED: Duration = Duration::from_millis(50);
/// How far the board runs between two looks at the command.
const STEP: Duration = Duration::from_millis(1);

const ERASED: u32 = u32::MAX;

/// A board with another program than the image.
struct Bench {
    image: FirmwareImage,
    command: PathBuf,
    board: EmulatedBoard,
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Option<Self> {
        let (firmware, command) = image_and_command_from_environment()?;
        let folder = tempfile::tempdir().expect("a folder");
        let other = folder.path().join("other.elf");
        std::fs::write(&other, other_program(&firmware)).expect("a file");
        let flash = MemoryFlash::default();
        let board = EmulatedBoard::start_with_probe(&other, &robot(), &hidden(), &flash, 0).expect("a board");
        let image = FirmwareImage::read(&firmware).expect("an image");
        Some(Self { image, command, board, folder })
    }

    /// A client of whatever program runs there now.
    fn greeted(&self) -> Client {
        self.board.run(STARTED);
        Client::connect_from(Box::new(self.board.link()), 1).expect("a board that answers")
    }

    fn start_flashing(&self, options: &[&str]) -> Child {
        Command::new(&self.command)
            .args(["flash", "--json", "--probe", &self.board.probe().expect("a probe").selector()])
            .args(options)
            .arg(&self.image.path)
            .current_dir(self.folder.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("a command that starts")
    }

    /// Lets the board's time go on while the probe is in use. The command looks for a link to the board in vain at its end.
    fn wait(&self, mut process: Child) -> Output {
        while process.try_wait().expect("a command").is_none() {
            if self.board.probe().is_some_and(|probe| probe.is_in_use()) {
                self.board.run(STEP);
            } else {
                std::thread::sleep(STEP);
            }
        }
        process.wait_with_output().expect("its output")
    }

    fn flash(&self, options: &[&str]) {
        let output = self.wait(self.start_flashing(options));
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let told: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        assert_eq!(told["bytes"], self.image.size());
        assert_eq!(self.words(&self.image_addresses()), self.image_words());
    }

    fn image_addresses(&self) -> Vec<u32> {
        let words = |address: u32, length: usize| (address..address + length as u32).step_by(4);
        self.image.segments.iter().flat_map(|segment| words(segment.address, segment.bytes.len() / 4 * 4)).collect()
    }

    fn image_words(&self) -> Vec<u32> {
        let words = self.image.segments.iter().flat_map(|segment| segment.bytes.chunks_exact(4));
        words.map(|word| u32::from_le_bytes(word.try_into().expect("four bytes"))).collect()
    }

    /// What stands in the chip's memory.
    fn words(&self, addresses: &[u32]) -> Vec<u32> {
        let addresses = addresses.to_vec();
        self.board.intervene(move |_, host, _| {
            let read = |&address: &u32| host.read(address.into(), Width::W32).expect("memory") as u32;
            addresses.iter().map(read).collect()
        })
    }
}

/// The image with another name for the board in it: a program that works, and is told from the image's by what it says.
fn other_program(firmware: &Path) -> Vec<u8> {
    let mut bytes = std::fs::read(firmware).expect("an image");
    let length = BOARD.len();
    let places: Vec<usize> =
        (0..bytes.len() - length).filter(|&at| bytes[at..at + length] == *BOARD.as_bytes()).collect();
    for at in places {
        bytes[at..at + length].copy_from_slice(OTHER_BOARD.as_bytes());
    }
    bytes
}

#[test]
fn a_board_in_motion_is_switched_off_before_its_program_is_replaced_and_keeps_its_parameters() {
    let Some(bench) = Bench::new() else { return };
    let mut client = bench.greeted();
    assert_eq!(client.info().identity.board, OTHER_BOARD);
    prepared(&mut client, &robot());
    client.upload(&true_model()).expect("an accepted model");
    client.wait_until_stored().expect("a stored model");
    client.load_trajectory(&nod()).expect("an accepted movement");
    client.arm().expect("a board that may be armed");
    let run = Request::Run { law: ControlLaw::Position, stream: false, settle_ns: 0 };
    client.request(run).expect("a movement");
    bench.board.run(Duration::from_millis(100));
    drop(client);

    bench.flash(&[]);
    let mut client = bench.greeted();
    assert_eq!(client.info().identity.board, BOARD, "the new program runs");
    assert_eq!(client.active_model().expect("an answer"), Some(true_model()), "with the model that was stored");
    drop(client);

    bench.flash(&["--erase-parameters"]);
    let mut client = bench.greeted();
    assert_eq!(client.info().robot_identity, None);
    assert_eq!(client.active_model().expect("an answer"), None);
    drop(client);

    let observations = bench.board.finish().expect("a run without error");
    observations.check_always();
    assert!(observations.was_probed);
    // That no use found the amplifiers on is among what is always checked.
    let of_program = |used: &&FlashUse| match used.operation {
        FlashOperation::Erase { address } | FlashOperation::Program { address } => {
            address < PARAMETER_FLASH.start.into()
        }
    };
    let first_ns = observations.flash_uses.iter().find(of_program).expect("a new program").at_ns;
    let was_on = |change: &OutputChange| change.outputs.amplifiers_enabled && change.at_ns < first_ns;
    assert!(observations.outputs.iter().any(was_on), "it was in motion");
    assert!(observations.restarts.iter().any(|restart| restart.at_ns <= first_ns), "it was reset first");
    println!("{} restarts, {} uses of the flash memory", observations.restarts.len(), observations.flash_uses.len());
}

#[test]
fn a_command_killed_in_the_middle_leaves_a_board_that_is_off_and_can_be_flashed_again() {
    let Some(bench) = Bench::new() else { return };
    assert_eq!(bench.greeted().info().identity.board, OTHER_BOARD);
    let (first, last) = (bench.image_addresses()[0], *bench.image_addresses().last().expect("words"));
    let mut process = bench.start_flashing(&[]);
    // Its beginning is programmed, its end not yet.
    while bench.words(&[first, last]) != [bench.image_words()[0], ERASED] {
        assert!(process.try_wait().expect("a command").is_none(), "it ended before it was killed");
        bench.board.run(STEP);
    }
    process.kill().expect("a command that runs");
    process.wait().expect("one that ended");
    while bench.board.probe().is_some_and(|probe| probe.is_in_use()) {
        bench.board.run(STEP);
    }
    bench.board.run(Duration::from_secs(1));

    bench.flash(&[]);
    assert_eq!(bench.greeted().info().identity.board, BOARD);
    let observations = bench.board.finish().expect("a run without error");
    observations.check_always();
    assert!(observations.outputs.iter().all(|change| !change.outputs.amplifiers_enabled));
}
