//! The place where a file's contents stand until they are whole, and who may write there: one program at a time.
//!
//! It is `NAME.armid.part` beside the file, locked as long as a program means to write the file. The system drops the lock of
//! a program that ends, however it ends: what stays behind then is nobody's, and the next program takes it over.

use std::collections::BTreeMap;
use std::fs::{self, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What the name of such a place ends in.
const ENDING: &str = ".armid.part";

/// Why there is no place to write to.
pub enum PlaceError {
    /// Another program, or another part of this one, is writing the file.
    Taken,
    /// The system's reason.
    Io(io::Error),
}

impl From<io::Error> for PlaceError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// A place of this program's own; taken away if the file does not become what stands there.
#[derive(Debug)]
pub struct Place {
    path: PathBuf,
    file: fs::File,
    became_the_file: bool,
}

impl Place {
    /// The place of the file at `target`: the one held since [`hold`], or a new one.
    pub fn of(target: &Path) -> Result<Self, PlaceError> {
        let path = path_of(target)?;
        let held = held().remove(&key(&path));
        // Its folder may have been taken away meanwhile.
        held.filter(|place| is_at(&place.file, &place.path)).map_or_else(|| Self::take(path), Ok)
    }

    fn take(path: PathBuf) -> Result<Self, PlaceError> {
        /// How often another program may come and go between two steps of this.
        const TRIES: usize = 100;
        // Opening a pipe would wait, and a link would lead to somebody else's file.
        if path.symlink_metadata().is_ok_and(|found| !found.is_file()) {
            return Err(io::Error::other(format!("{} is in the way and no file: move it away", path.display())).into());
        }
        for _ in 0..TRIES {
            let file = fs::File::options().write(true).create(true).truncate(false).open(&path)?;
            match file.try_lock() {
                // Between opening and locking it may have become another program's file, or have been taken away.
                Ok(()) if is_at(&file, &path) => return Ok(Self { path, file, became_the_file: false }),
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(PlaceError::Taken),
                Err(TryLockError::Error(_)) => return Ok(Self::unlocked(&path)?),
            }
        }
        Err(PlaceError::Taken)
    }

    /// Where the file system has no locks nobody can be kept off, but at least nobody's contents get mixed with another's.
    fn unlocked(path: &Path) -> io::Result<Self> {
        let _ = fs::remove_file(path);
        let path = path.with_extension(format!("{}.part", std::process::id()));
        Ok(Self { file: fs::File::create(&path)?, path, became_the_file: false })
    }

    /// Puts `contents` there, on disk.
    pub fn fill(&mut self, contents: &[u8]) -> io::Result<()> {
        use io::Write as _;
        self.file.set_len(0)?;
        self.file.write_all(contents)?;
        self.file.sync_all()
    }

    /// The file at `target` becomes what stands here.
    pub fn become_file(mut self, target: &Path) -> io::Result<()> {
        fs::rename(&self.path, target)?;
        self.became_the_file = true;
        Ok(())
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        // While it is still locked, so that it is nobody else's. A leftover is only untidy.
        if !self.became_the_file && is_at(&self.file, &self.path) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// Places of files that this program means to write, but has no contents for yet.
static HELD: Mutex<BTreeMap<PathBuf, Place>> = Mutex::new(BTreeMap::new());

fn held() -> MutexGuard<'static, BTreeMap<PathBuf, Place>> {
    HELD.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps every other program from writing the file at `target` until this one has written it, or ends.
pub fn hold(target: &Path) -> Result<(), PlaceError> {
    let path = path_of(target)?;
    let mut held = held();
    if held.get(&key(&path)).is_none_or(|place| !is_at(&place.file, &place.path)) {
        let place = Place::take(path)?;
        held.insert(key(&place.path), place);
    }
    Ok(())
}

/// Gives up every place that is held without contents. A program calls this before it ends; one that cannot leaves empty
/// places behind.
pub fn release() {
    held().clear();
}

/// Places in `folder` that no program holds: those of programs that were ended.
pub fn abandoned(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let places = entries.filter(|entry| {
        entry.file_name().to_string_lossy().ends_with(ENDING) && entry.file_type().is_ok_and(|kind| kind.is_file())
    });
    let nobodys = |path: &PathBuf| fs::File::options().write(true).open(path).is_ok_and(|file| file.try_lock().is_ok());
    let mut paths: Vec<PathBuf> = places.map(|entry| entry.path()).filter(nobodys).collect();
    paths.sort();
    paths
}

/// Where the contents of the file at `target` stand until they are whole; in the same folder, which is made if it is missing.
fn path_of(target: &Path) -> io::Result<PathBuf> {
    // A path that ends in a separator names a folder, whether it exists or not; the separator is lost in `file_name`.
    let names_folder = target.as_os_str().to_string_lossy().ends_with(std::path::is_separator);
    let name = target.file_name().filter(|_| !names_folder && !target.is_dir());
    let name = name.ok_or_else(|| io::Error::new(io::ErrorKind::IsADirectory, "it is a folder, not a file"))?;
    if let Some(folder) = target.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        fs::create_dir_all(folder)?;
    }
    let mut name = name.to_os_string();
    name.push(ENDING);
    Ok(target.with_file_name(name))
}

/// The same for every way to write one path.
fn key(path: &Path) -> PathBuf {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let whole = folder.canonicalize().or_else(|_| std::path::absolute(folder)).unwrap_or_else(|_| folder.to_path_buf());
    path.file_name().map_or_else(|| whole.clone(), |name| whole.join(name))
}

/// Whether `file` is what stands at `path`.
#[cfg(unix)]
fn is_at(file: &fs::File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let identity = |found: io::Result<fs::Metadata>| found.map(|found| (found.dev(), found.ino())).ok();
    let stands = identity(path.symlink_metadata());
    stands.is_some() && stands == identity(file.metadata())
}

/// Whether `file` is what stands at `path`, as far as can be told here.
#[cfg(not(unix))]
fn is_at(_file: &fs::File, path: &Path) -> bool {
    path.is_file()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_one_holders_until_it_becomes_the_file_or_is_given_up() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("model.toml");
        let mut first = Place::of(&target).ok().unwrap();
        assert!(matches!(Place::of(&target), Err(PlaceError::Taken)));
        assert!(matches!(hold(&target), Err(PlaceError::Taken)) && abandoned(folder.path()).is_empty());
        first.fill(b"first").unwrap();
        first.become_file(&target).unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"first");

        // What is held is this program's own place, however the path is written.
        hold(&target).ok().unwrap();
        hold(&target).ok().unwrap();
        let same = folder.path().join("new/../model.toml");
        fs::create_dir(folder.path().join("new")).unwrap();
        drop(Place::of(&same).ok().unwrap());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn what_an_ended_program_left_is_taken_over_and_what_is_in_the_way_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("model.toml");
        let left = folder.path().join("model.toml.armid.part");
        fs::write(&left, "half of a longer result").unwrap();
        assert_eq!(abandoned(folder.path()), std::slice::from_ref(&left));
        let mut place = Place::of(&target).ok().unwrap();
        place.fill(b"whole").unwrap();
        place.become_file(&target).unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"whole");
        assert!(!left.exists());

        fs::create_dir(&left).unwrap();
        let Err(PlaceError::Io(error)) = Place::of(&target) else { panic!("a folder was written into") };
        assert!(error.to_string().contains("in the way"), "{error}");
        assert!(abandoned(folder.path()).is_empty());
    }

    #[test]
    fn a_place_whose_folder_was_taken_away_is_made_anew() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("out/model.toml");
        hold(&target).ok().unwrap();
        fs::remove_dir_all(folder.path().join("out")).unwrap();
        let mut place = Place::of(&target).ok().unwrap();
        place.fill(b"whole").unwrap();
        place.become_file(&target).unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"whole");
    }
}
