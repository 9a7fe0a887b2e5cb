//! What readers read: a file, an excerpt of one in memory, or whatever can be read and sought in.

use std::fmt;
use std::fs::File;
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use super::compressed::{self, Unpacked};
use super::file::file_of;
use crate::error::{Error, Location, Result};
use crate::geometry::Vec3;

/// The first bytes of a Parquet file, and also its last.
pub(crate) const PARQUET: &[u8] = b"PAR1";

/// The bytes of a file, of an excerpt of it or of a reader, and its path for messages. It can be opened more than once,
/// each time with a position of its own. The format is detected, and a compressed file is unpacked, once for all clones
/// and all readings [`again`](Self::again).
#[derive(Clone)]
pub struct Input(Arc<Content>);

struct Content {
    path: PathBuf,
    source: Source,
    known: Arc<Known>,
    notes: Arc<Mutex<Notes>>,
    point_times: PointTimes,
}

/// What is known of the bytes since they were first opened.
#[derive(Default)]
struct Known {
    /// The content of a compressed file.
    unpacked: OnceLock<Shared>,
    /// The index of the format among all formats.
    detected: OnceLock<usize>,
}

/// What readers found beside the data that they return.
#[derive(Debug, Default)]
struct Notes {
    remarks: Vec<String>,
    viewpoints_m: Vec<Vec3>,
}

/// What a recording does not say about the times of the points in its clouds.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PointTimes {
    /// The field of a point that holds its time; `None`: one of the known names.
    pub field: Option<String>,
    /// The unit of this field, seconds; `None`: by the type of the field.
    pub unit_s: Option<f64>,
}

/// Where the bytes are.
#[derive(Clone)]
enum Source {
    /// In the file at the path.
    File,
    Excerpt(Excerpt),
    Reader(Shared),
}

#[derive(Debug, Clone)]
pub(crate) struct Excerpt(Arc<[u8]>);

/// What can be read from any position.
trait Bytes: Read + Seek + Send {}

impl<T: Read + Seek + Send> Bytes for T {}

/// A position in a reader that others read too.
#[derive(Clone)]
pub(crate) struct Shared {
    reader: Arc<Mutex<dyn Bytes>>,
    position: u64,
    size: u64,
}

impl Shared {
    /// The beginning of a reader of `size` bytes.
    fn new(reader: impl Read + Seek + Send + 'static, size: u64) -> Self {
        Self {
            reader: Arc::new(Mutex::new(reader)),
            position: 0,
            size,
        }
    }
}

impl fmt::Debug for Shared {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a reader of {} bytes at {}", self.size, self.position)
    }
}

impl Read for Shared {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let reader = self.reader.lock();
        let mut reader = reader.unwrap_or_else(PoisonError::into_inner);
        reader.seek(SeekFrom::Start(self.position))?;
        let read = reader.read(into)?;
        self.position += read as u64;
        Ok(read)
    }
}

impl Seek for Shared {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let target = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::End(offset) => self.size.checked_add_signed(offset),
            SeekFrom::Current(offset) => self.position.checked_add_signed(offset),
        };
        let before = || {
            io::Error::new(
                io::ErrorKind::InvalidInput,
                "a position before the first byte",
            )
        };
        self.position = target.ok_or_else(before)?;
        Ok(self.position)
    }
}

impl AsRef<[u8]> for Excerpt {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

impl Input {
    /// Some records of the log at `path`, below its header if it has one. Files that lie beside the log do not apply
    /// to an excerpt, and an excerpt of a table of positions may hold no position.
    pub fn excerpt(path: &Path, bytes: Vec<u8>) -> Self {
        Self::new(path, Source::Excerpt(Excerpt(bytes.into())), Arc::default())
    }

    /// A whole file that `reader` reads: in memory, in an archive, in a store of objects. Messages name it by `name`,
    /// whose extension also tells formats apart that have no mark. Files beside it are not looked for, and Parquet,
    /// which is read by several threads at once, must be a file.
    ///
    /// # Errors
    /// The end of the reader cannot be found.
    pub fn from_reader(
        name: impl AsRef<Path>,
        mut reader: impl Read + Seek + Send + 'static,
    ) -> Result<Self> {
        let name = name.as_ref();
        let size = reader.seek(SeekFrom::End(0));
        let shared = Shared::new(reader, size.map_err(|e| Error::io(name, e))?);
        Ok(Self::new(name, Source::Reader(shared), Arc::default()))
    }

    fn new(path: &Path, source: Source, notes: Arc<Mutex<Notes>>) -> Self {
        Self(Arc::new(Content {
            path: path.to_owned(),
            source,
            known: Arc::default(),
            notes,
            point_times: PointTimes::default(),
        }))
    }

    /// This file, with `point_times` for the points of its clouds.
    pub fn with_point_times(&self, point_times: PointTimes) -> Self {
        self.of_content(self.0.notes.clone(), point_times)
    }

    /// This file for another reading, whose readers' remarks are its own.
    pub fn again(&self) -> Self {
        self.of_content(Arc::default(), self.0.point_times.clone())
    }

    fn of_content(&self, notes: Arc<Mutex<Notes>>, point_times: PointTimes) -> Self {
        Self(Arc::new(Content {
            path: self.0.path.clone(),
            source: self.0.source.clone(),
            known: self.0.known.clone(),
            notes,
            point_times,
        }))
    }

    /// What the user says about the times of points.
    pub(crate) fn point_times(&self) -> &PointTimes {
        &self.0.point_times
    }

    /// The file of which this input names a part; remarks on it are remarks on this input.
    pub(crate) fn of_file(&self, file: &Path) -> Self {
        Self::new(file, Source::File, self.0.notes.clone())
            .with_point_times(self.0.point_times.clone())
    }

    /// Keeps a sentence on what a reader left out or assumed; the same sentence is kept once.
    pub fn remark(&self, text: impl Into<String>) {
        let text = text.into();
        let remarks = &mut self.notes().remarks;
        if !remarks.contains(&text) {
            remarks.push(text);
        }
    }

    /// What the readers of this input and of its clones left out or assumed so far.
    pub fn remarks(&self) -> Vec<String> {
        self.notes().remarks.clone()
    }

    /// Keeps the places from which the points of a cloud were seen.
    pub(crate) fn seen_from(&self, viewpoints_m: Vec<Vec3>) {
        self.notes().viewpoints_m = viewpoints_m;
    }

    /// The places from which the points of the cloud were seen (metres, in its frame), as far as the file says so;
    /// empty before the cloud is read.
    pub fn viewpoints_m(&self) -> Vec<Vec3> {
        self.notes().viewpoints_m.clone()
    }

    fn notes(&self) -> MutexGuard<'_, Notes> {
        let notes = self.0.notes.lock();
        notes.unwrap_or_else(PoisonError::into_inner)
    }

    /// The path of the file, which may also name a part of the file after a `#`.
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// Whether it is an excerpt in memory.
    pub(crate) fn is_excerpt(&self) -> bool {
        matches!(self.0.source, Source::Excerpt(_))
    }

    /// Whether it is the file at its path, beside which there may be others.
    pub(crate) fn is_file(&self) -> bool {
        matches!(self.0.source, Source::File)
    }

    /// The index of its format among all formats, which `detect` finds the first time.
    pub(super) fn detected(&self, detect: impl FnOnce() -> Result<usize>) -> Result<usize> {
        if let Some(index) = self.0.known.detected.get() {
            return Ok(*index);
        }
        let index = detect()?;
        Ok(*self.0.known.detected.get_or_init(|| index))
    }

    /// The bytes from the beginning, and their number.
    ///
    /// # Errors
    /// A file that is missing, empty or no regular file.
    pub(crate) fn open(&self) -> Result<(Stream, u64)> {
        let path = &file_of(self.path());
        let (stream, size) = match &self.0.source {
            Source::Excerpt(excerpt) => {
                let size = excerpt.0.len() as u64;
                (Stream::Excerpt(Cursor::new(excerpt.clone())), size)
            }
            Source::Reader(shared) => self.unpacked(Stream::Shared(shared.clone()), shared.size)?,
            Source::File => {
                let (file, size) = open_file(path)?;
                self.unpacked(Stream::File(file), size)?
            }
        };
        if size == 0 {
            return Err(Error::format(
                path,
                Location::Whole,
                "an empty file",
                "data",
            ));
        }
        Ok((stream, size))
    }

    /// The content of a file of this size, unpacked if it is compressed with gzip or Zstandard.
    fn unpacked(&self, mut stream: Stream, size: u64) -> Result<(Stream, u64)> {
        let unpacked = &self.0.known.unpacked;
        let content = match unpacked.get() {
            Some(content) => content,
            None => match compressed::unpack(self.path(), &mut stream, size)? {
                Some(Unpacked { content, size }) => {
                    unpacked.get_or_init(|| Shared::new(content, size))
                }
                None => return Ok((stream, size)),
            },
        };
        Ok((Stream::Shared(content.clone()), content.size))
    }

    /// The file itself, for decoders that need one; also its size in bytes.
    ///
    /// # Errors
    /// Those of [`open`](Self::open); an excerpt.
    #[cfg(feature = "parquet")]
    pub(crate) fn open_file(&self) -> Result<(File, u64)> {
        match self.open()? {
            (Stream::File(file), size) => Ok((file, size)),
            (Stream::Excerpt(_) | Stream::Shared(_), _) => Err(Error::format(
                self.path(),
                Location::Whole,
                "a compressed file or bytes that are no file",
                "a whole file that is not compressed",
            )),
        }
    }

    /// The first bytes of an opened input, up to 4096; it is left at its beginning.
    pub(crate) fn first_bytes(&self, stream: &mut Stream) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        stream
            .take(4096)
            .read_to_end(&mut bytes)
            .and_then(|_| stream.rewind())
            .map_err(|e| Error::io(self.path(), e))?;
        Ok(bytes)
    }

    /// Whether it is Parquet; false if it cannot be read.
    pub fn is_parquet(&self) -> bool {
        self.open().is_ok_and(|(mut stream, _)| {
            let mut start = [0; PARQUET.len()];
            stream.read_exact(&mut start).is_ok() && start == PARQUET
        })
    }
}

/// Opens a regular file; also returns its size in bytes.
fn open_file(path: &Path) -> Result<(File, u64)> {
    // Opening a pipe would wait for a writer.
    let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, e))?;
    if !metadata.is_file() {
        let file_type = if metadata.is_dir() {
            "a folder"
        } else {
            "a pipe or a device"
        };
        return Err(Error::format(path, Location::Whole, file_type, "a file"));
    }
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    Ok((file, metadata.len()))
}

impl<P: AsRef<Path> + ?Sized> From<&P> for Input {
    fn from(path: &P) -> Self {
        Self::new(path.as_ref(), Source::File, Arc::default())
    }
}

impl From<&Self> for Input {
    fn from(input: &Self) -> Self {
        input.clone()
    }
}

impl fmt::Debug for Input {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path().display())
    }
}

/// The bytes of an open input.
#[derive(Debug)]
pub(crate) enum Stream {
    File(File),
    Excerpt(Cursor<Excerpt>),
    Shared(Shared),
}

impl Stream {
    pub(crate) fn in_memory(bytes: Vec<u8>) -> Self {
        Self::Excerpt(Cursor::new(Excerpt(bytes.into())))
    }
}

impl Read for Stream {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.read(into),
            Self::Excerpt(bytes) => bytes.read(into),
            Self::Shared(reader) => reader.read(into),
        }
    }
}

impl Seek for Stream {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::File(file) => file.seek(to),
            Self::Excerpt(bytes) => bytes.seek(to),
            Self::Shared(reader) => reader.seek(to),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{read_cloud, read_imu};

    const IMU: &str = "time_s,gyro_x_rad_s,gyro_y_rad_s,gyro_z_rad_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2\n\
                       1.0,0,0,0.1,0,0,-9.8\n1.01,0,0,0.2,0,0,-9.8\n";

    #[test]
    fn readers_are_read_as_files_are() {
        let input = Input::from_reader("imu.csv", Cursor::new(IMU)).unwrap();
        let samples = read_imu(&input).unwrap();
        assert_eq!(samples.len(), 2);
        assert_eq!(samples[1].gyro_rad_s.z, 0.2);
        let mut packed = flate2::read::GzEncoder::new(IMU.as_bytes(), flate2::Compression::fast());
        let mut bytes = Vec::new();
        packed.read_to_end(&mut bytes).unwrap();
        let input = Input::from_reader("imu.csv.gz", Cursor::new(bytes)).unwrap();
        assert_eq!(read_imu(&input).unwrap(), samples);
        let input = Input::from_reader("points.xyz", Cursor::new("1 2 3\n4 5 6\n")).unwrap();
        assert_eq!(read_cloud(&input).unwrap().points.len(), 2);
        let empty = Input::from_reader("empty.csv", Cursor::new("")).unwrap();
        let error = read_imu(&empty).unwrap_err().to_string();
        assert!(error.contains("empty.csv: found an empty file"), "{error}");
    }

    #[test]
    fn a_file_is_unpacked_and_its_format_detected_once_for_all_readings() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("imu.csv.gz");
        let mut packed = flate2::read::GzEncoder::new(IMU.as_bytes(), flate2::Compression::fast());
        let mut bytes = Vec::new();
        packed.read_to_end(&mut bytes).unwrap();
        std::fs::write(&path, bytes).unwrap();
        let first = Input::from(&path);
        let samples = read_imu(&first).unwrap();
        first.remark("on the first reading");
        // Damage after the first bytes, by which it is known to be compressed.
        std::fs::write(&path, [0x1f, 0x8b, 0, 0, 0, 0]).unwrap();
        let second = first.again();
        assert_eq!(read_imu(&second).unwrap(), samples);
        assert!(second.remarks().is_empty());
        assert!(read_imu(&path).is_err());
        let unreached = || panic!("its format is known");
        second.detected(unreached).unwrap();
    }

    #[test]
    fn each_stream_has_its_own_position() {
        let input = Input::from_reader("digits", Cursor::new("0123456789")).unwrap();
        let [mut first, mut second] = [(); 2].map(|()| input.open().unwrap().0);
        let mut two = [0; 2];
        first.read_exact(&mut two).unwrap();
        assert_eq!(second.seek(SeekFrom::End(-3)).unwrap(), 7);
        second.read_exact(&mut two).unwrap();
        assert_eq!(&two, b"78");
        first.read_exact(&mut two).unwrap();
        assert_eq!(&two, b"23");
        assert!(first.seek(SeekFrom::Current(-5)).is_err());
    }
}
