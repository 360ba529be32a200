//! WebDataset: tar files of a thousand samples each; a sample is the files that share a name up to the first dot.

use std::collections::BTreeMap;
use std::fs::File;

use retina_batch::BatchError;
use serde_json::json;
use tar::{Builder, EntryType, Header};

use crate::export::Writer;
use crate::frames::{Frame, KEYPOINTS, Seen, keypoints};
use crate::out::Out;

const CHUNK: usize = 1000;

/// A tar file that is being written, and how many samples it holds.
struct Shard {
    number: usize,
    samples: usize,
    builder: Builder<File>,
}

#[derive(Default)]
pub(crate) struct WebDataset {
    shards: BTreeMap<&'static str, Shard>,
}

impl Writer for WebDataset {
    fn add(&mut self, out: &Out, frame: &Frame, is_validation: bool) -> Result<(), BatchError> {
        let part = if is_validation { "val" } else { "train" };
        let number = match self.shards.get(part) {
            None => Some(0),
            Some(shard) if shard.samples == CHUNK => Some(shard.number + 1),
            Some(_) => None,
        };
        if let Some(number) = number {
            self.close(part, out)?;
            let path = out.path(&format!("{part}-{number:06}.tar"));
            let file = File::create(&path).map_err(|source| BatchError::Write { path, source })?;
            self.shards.insert(part, Shard { number, samples: 0, builder: Builder::new(file) });
        }
        let seen = frame.seen();
        let mut document = frame.document.clone();
        document["bodies_px"] = seen
            .iter()
            .map(|own| {
                let Seen { name, visible: silhouette, .. } = own;
                let points = keypoints(own, &frame.truth.image_px);
                let points = KEYPOINTS
                    .iter()
                    .map(|name| (*name).to_owned())
                    .zip(points.iter().map(|point| json!(point)));
                let entry = json!({
                    "bbox": silhouette.bounds(),
                    "area": silhouette.area(),
                    "keypoints": points.collect::<serde_json::Map<_, _>>(),
                });
                ((*name).to_owned(), entry)
            })
            .collect::<serde_json::Map<_, _>>()
            .into();
        let mut files = vec![
            ("png".to_owned(), frame.png.clone()),
            ("json".to_owned(), format!("{document}\n").into_bytes()),
        ];
        for Seen { name, visible, .. } in &seen {
            files.push((format!("{name}.mask.png"), visible.png()?));
        }
        let Some(shard) = self.shards.get_mut(part) else { return Ok(()) };
        shard.samples += 1;
        for (extension, bytes) in files {
            // The same bytes again: no times, no owners.
            let mut header = Header::new_ustar();
            header.set_entry_type(EntryType::Regular);
            header.set_size(bytes.len() as u64);
            header.set_mode(0o644);
            header.set_mtime(0);
            let name = format!("{:06}.{extension}", frame.index);
            shard
                .builder
                .append_data(&mut header, name, bytes.as_slice())
                .map_err(|source| BatchError::Write { path: out.path(part), source })?;
        }
        Ok(())
    }

    fn finish(&mut self, out: &Out) -> Result<(), BatchError> {
        self.close("train", out)?;
        self.close("val", out)
    }
}

impl WebDataset {
    fn close(&mut self, part: &'static str, out: &Out) -> Result<(), BatchError> {
        let Some(shard) = self.shards.remove(part) else { return Ok(()) };
        shard
            .builder
            .into_inner()
            .and_then(|file| file.sync_data())
            .map_err(|source| BatchError::Write { path: out.path(part), source })
    }
}
