//! Finding an adapter and opening it.

use crate::RenderError;

/// An opened graphics device.
pub struct GpuDevice {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    name: String,
    driver: String,
    is_software: bool,
}

/// Storage buffers that the largest stage binds.
const STORAGE_BUFFERS: u32 = 4;

/// Width of a texture that holds an array; shaders/shared/types.wgsl counts on it.
const TEXELS_PER_ROW: u32 = 4096;

/// Whether this value of the environment variable `CI` says that the tests run for a verdict.
fn is_demanded(ci: &str) -> bool {
    !["", "0", "false"].contains(&ci.trim().to_ascii_lowercase().as_str())
}

/// The first adapter; a real GPU is preferred to a software one.
fn first_adapter() -> Result<wgpu::Adapter, RenderError> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::PRIMARY,
        // The arguments of indirect dispatches are bounded in shaders/refine_plan.wgsl; wgpu's own
        // check of each one took most of a small frame's time on lavapipe, and its memory.
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::HighPerformance,
        ..Default::default()
    }))
    .map_err(|error| RenderError::NoAdapter(error.to_string()))
}

impl GpuDevice {
    /// Opens the first suitable adapter; a real GPU is preferred to a software one.
    ///
    /// # Errors
    /// There is none, or it lacks what the shaders need.
    pub fn open() -> Result<Self, RenderError> {
        Self::of_adapter(&first_adapter()?)
    }

    /// Opens a real GPU. [`crate::NativeRenderer`] is quicker than an adapter that is a program on the processor.
    ///
    /// # Errors
    /// There is none, or it lacks what the shaders need.
    pub fn open_hardware() -> Result<Self, RenderError> {
        let adapter = first_adapter()?;
        let info = adapter.get_info();
        if info.device_type == wgpu::DeviceType::Cpu {
            return Err(RenderError::NoAdapter(format!("{} is a program on the processor", info.name)));
        }
        Self::of_adapter(&adapter)
    }

    fn of_adapter(adapter: &wgpu::Adapter) -> Result<Self, RenderError> {
        let info = adapter.get_info();
        let allowed = adapter.limits();
        if !adapter.features().contains(wgpu::Features::PRIMITIVE_INDEX) {
            return Err(RenderError::NoAdapter(format!("{} does not number primitives", info.name)));
        }
        if allowed.max_storage_buffers_per_shader_stage < STORAGE_BUFFERS {
            return Err(RenderError::NoAdapter(format!("{} binds too few storage buffers", info.name)));
        }
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("retina"),
            required_features: wgpu::Features::PRIMITIVE_INDEX,
            required_limits: allowed,
            memory_hints: wgpu::MemoryHints::Performance,
            ..Default::default()
        }))
        .map_err(|error| RenderError::NoAdapter(format!("{}: {error}", info.name)))?;
        let driver = format!("{} {}", info.driver, info.driver_info);
        let is_software = info.device_type == wgpu::DeviceType::Cpu;
        Ok(Self { device, queue, name: info.name, driver, is_software })
    }

    /// For tests that need an adapter: [`GpuDevice::open`], or `None` with a word on standard error.
    ///
    /// # Panics
    /// There is none where the environment variable `CI` is set: there such a test must not pass unrun.
    pub fn open_for_test() -> Option<Self> {
        let error = match Self::open() {
            Ok(gpu) => return Some(gpu),
            Err(error) => error,
        };
        let ci = std::env::var("CI").unwrap_or_default();
        assert!(!is_demanded(&ci), "CI={ci} demands a graphics adapter for this test: {error}");
        eprintln!("skipped: {error}");
        None
    }

    /// Name of the adapter.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Name and version of the driver.
    pub fn driver(&self) -> &str {
        &self.driver
    }

    /// Whether the adapter is a program on the CPU, as Mesa's llvmpipe is.
    pub(crate) fn is_software(&self) -> bool {
        self.is_software
    }

    /// A buffer with this content; refused when it is larger than the adapter binds.
    pub(crate) fn filled_buffer<T: bytemuck::Pod>(
        &self,
        what: &'static str,
        content: &[T],
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, RenderError> {
        let bytes: &[u8] = bytemuck::cast_slice(content);
        let buffer = self.buffer(what, bytes.len() as u64, usage | wgpu::BufferUsages::COPY_DST)?;
        self.queue.write_buffer(&buffer, 0, bytes);
        Ok(buffer)
    }

    /// An array as a texture of [`TEXELS_PER_ROW`] texels a row; `T` is a whole number of texels.
    pub(crate) fn array_texture<T: bytemuck::Pod>(
        &self,
        what: &'static str,
        content: &[T],
        format: wgpu::TextureFormat,
    ) -> Result<wgpu::TextureView, RenderError> {
        let texel = format.block_copy_size(None).unwrap_or(16);
        let row_bytes = u64::from(texel) * u64::from(TEXELS_PER_ROW);
        let mut bytes = bytemuck::cast_slice::<T, u8>(content).to_vec();
        let rows = (bytes.len() as u64).div_ceil(row_bytes).max(1);
        let allowed = u64::from(self.device.limits().max_texture_dimension_2d);
        if rows > allowed {
            return Err(RenderError::TooLarge { what, needed: rows, allowed, adapter: self.name.clone() });
        }
        bytes.resize((rows * row_bytes) as usize, 0);
        let size = wgpu::Extent3d { width: TEXELS_PER_ROW, height: rows as u32, depth_or_array_layers: 1 };
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(what),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(row_bytes as u32),
            rows_per_image: None,
        };
        self.queue.write_texture(texture.as_image_copy(), &bytes, layout, size);
        Ok(texture.create_view(&Default::default()))
    }

    pub(crate) fn buffer(
        &self,
        what: &'static str,
        size: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, RenderError> {
        let limits = self.device.limits();
        let allowed = if usage.contains(wgpu::BufferUsages::STORAGE) {
            limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
        } else {
            limits.max_buffer_size
        };
        let needed = size.next_multiple_of(16).max(16);
        if needed > allowed {
            return Err(RenderError::TooLarge { what, needed, allowed, adapter: self.name.clone() });
        }
        Ok(self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(what),
            size: needed,
            usage,
            mapped_at_creation: false,
        }))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may fail")]
mod tests {
    use std::process::Command;

    use super::*;

    #[test]
    fn ci_is_what_is_neither_empty_nor_false() {
        assert!(["", "0", "false", "False", " "].iter().all(|ci| !is_demanded(ci)));
        assert!(["1", "true", "yes", "github"].iter().all(|ci| is_demanded(ci)));
    }

    #[test]
    fn without_an_adapter_a_test_skips_except_in_ci() {
        // The test below, in a process that finds no driver.
        let run = |ci: &str| {
            let mut command = Command::new(std::env::current_exe().unwrap());
            command.args(["--exact", "gpu::device::tests::an_adapter_is_there", "--nocapture"]);
            for name in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
                command.env(name, "/nonexistent.json");
            }
            let output = command.env_remove("VK_ADD_DRIVER_FILES").env("CI", ci).output().unwrap();
            (output.status.success(), String::from_utf8_lossy(&output.stderr).into_owned())
        };
        // Other systems' graphics interfaces do not read these variables.
        if cfg!(target_os = "linux") {
            let (passed, said) = run("false");
            assert!(passed && said.contains("skipped: "), "{said}");
            let (passed, said) = run("true");
            assert!(!passed && said.contains("CI=true demands a graphics adapter for this test"), "{said}");
        }
    }

    #[test]
    fn an_adapter_is_there() {
        assert!(GpuDevice::open_for_test().is_none_or(|gpu| !gpu.name().is_empty()));
    }
}
