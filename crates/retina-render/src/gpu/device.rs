//! Finding an adapter and opening it.

use crate::RenderError;

/// An opened graphics device.
pub struct GpuDevice {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    name: String,
    driver: String,
}

/// Storage buffers that the largest stage binds.
const STORAGE_BUFFERS: u32 = 12;

impl GpuDevice {
    /// Opens the first suitable adapter; a real GPU is preferred to a software one.
    ///
    /// # Errors
    /// There is none, or it lacks what the shaders need.
    pub fn open() -> Result<Self, RenderError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: wgpu::Backends::PRIMARY,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            ..Default::default()
        }))
        .map_err(|error| RenderError::NoAdapter(error.to_string()))?;
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
        Ok(Self { device, queue, name: info.name, driver })
    }

    /// Name of the adapter.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Name and version of the driver.
    pub fn driver(&self) -> &str {
        &self.driver
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

    pub(crate) fn buffer(
        &self,
        what: &'static str,
        size: u64,
        usage: wgpu::BufferUsages,
    ) -> Result<wgpu::Buffer, RenderError> {
        let limits = self.device.limits();
        let allowed = if usage.contains(wgpu::BufferUsages::STORAGE) {
            u64::from(limits.max_storage_buffer_binding_size).min(limits.max_buffer_size)
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
