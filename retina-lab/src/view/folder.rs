//! A folder as a screen: it shows the image that was written last.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use retina_bench::ScreenImage;
use retina_campaign::read_screen;
use retina_files::InputError;

use super::ScreenView;
use crate::LabError;

pub(crate) struct FolderView {
    folder: PathBuf,
    size_px: [u32; 2],
    dark: Arc<ScreenImage>,
    shown: Option<(SystemTime, PathBuf, Arc<ScreenImage>)>,
}

impl FolderView {
    pub(crate) fn open(folder: &Path, size_px: [u32; 2]) -> Result<Self, LabError> {
        if !folder.is_dir() {
            return Err(InputError::new(folder, "is no folder")
                .help("make it, or name another screen")
                .into());
        }
        let dark = Arc::new(ScreenImage::dark(size_px[0], size_px[1]));
        Ok(Self { folder: folder.into(), size_px, dark, shown: None })
    }

    /// The PNG file that was written last; of several of one time the last by name.
    fn newest(&self) -> Result<Option<(SystemTime, PathBuf)>, InputError> {
        let unreadable =
            |error: std::io::Error| InputError::new(&self.folder, format!("cannot be read: {error}"));
        let mut newest = None;
        for entry in std::fs::read_dir(&self.folder).map_err(unreadable)? {
            let path = entry.map_err(unreadable)?.path();
            // Files that are being written have names of their own.
            let hidden = path.file_name().is_none_or(|name| name.to_string_lossy().starts_with('.'));
            if hidden || path.extension().is_none_or(|extension| extension != "png") {
                continue;
            }
            // Gone since the folder was listed: another image takes its place.
            let Ok(time) = path.metadata().and_then(|found| found.modified()) else { continue };
            newest = newest.max(Some((time, path)));
        }
        Ok(newest)
    }
}

impl ScreenView for FolderView {
    /// Dark while the folder holds no image.
    fn read(&mut self) -> Result<Arc<ScreenImage>, LabError> {
        let Some((time, path)) = self.newest()? else { return Ok(Arc::clone(&self.dark)) };
        if let Some((shown_time, shown_path, image)) = &self.shown
            && (*shown_time, shown_path) == (time, &path)
        {
            return Ok(Arc::clone(image));
        }
        let image = read_screen(&path)?;
        let found = [image.width_px, image.height_px];
        if found != self.size_px {
            return Err(InputError::new(&path, "has another size than the setup's screen")
                .found(format!("{} x {} px", found[0], found[1]))
                .expected(format!("{} x {} px", self.size_px[0], self.size_px[1]))
                .into());
        }
        let image = Arc::new(image);
        self.shown = Some((time, path, Arc::clone(&image)));
        Ok(image)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_image_written_last_is_shown_and_dark_before() {
        let dir = tempfile::tempdir().unwrap();
        let mut view = FolderView::open(dir.path(), [4, 2]).unwrap();
        assert!(view.read().unwrap().counts.iter().all(|counts| *counts == [0; 3]));
        let write = |name: &str, size: [u32; 2], value: u8, second: u64| {
            let path = dir.path().join(name);
            image::GrayImage::from_pixel(size[0], size[1], image::Luma([value])).save(&path).unwrap();
            let time = SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(second);
            std::fs::File::open(&path).unwrap().set_modified(time).unwrap();
        };
        write("b.png", [4, 2], 7, 100);
        assert_eq!(view.read().unwrap().counts[0], [7; 3]);
        write("a.png", [4, 2], 9, 200);
        let first = view.read().unwrap();
        assert_eq!(first.counts[0], [9; 3]);
        assert!(Arc::ptr_eq(&first, &view.read().unwrap()));
        write("c.png", [4, 3], 9, 300);
        assert!(view.read().unwrap_err().to_string().contains("another size"));
    }
}
