//! Layouts, bind groups and compute pipelines in a few words.

use super::device::Gpu;

/// What a shader reads or writes at a binding.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    Uniform,
    Read,
    Write,
    Depth,
    Numbers,
}

/// A layout of bindings 0, 1, 2, …
pub(super) fn layout(device: &wgpu::Device, label: &str, of: &[(wgpu::ShaderStages, Kind)]) -> wgpu::BindGroupLayout {
    let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let storage = |read_only| buffer(wgpu::BufferBindingType::Storage { read_only });
    let texture = |sample_type| wgpu::BindingType::Texture {
        sample_type,
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let entry = |(binding, &(visibility, kind)): (u32, &(wgpu::ShaderStages, Kind))| wgpu::BindGroupLayoutEntry {
        binding,
        visibility,
        ty: match kind {
            Kind::Uniform => buffer(wgpu::BufferBindingType::Uniform),
            Kind::Read => storage(true),
            Kind::Write => storage(false),
            Kind::Depth => texture(wgpu::TextureSampleType::Depth),
            Kind::Numbers => texture(wgpu::TextureSampleType::Uint),
        },
        count: None,
    };
    let entries: Vec<_> = (0..).zip(of).map(entry).collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

/// Binds resources at 0, 1, 2, …
pub(super) fn bind(gpu: &Gpu, layout: &wgpu::BindGroupLayout, resources: &[wgpu::BindingResource<'_>]) -> wgpu::BindGroup {
    let entries: Vec<_> =
        (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource: resource.clone() }).collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}

/// One shader module with all of a source.
pub(super) fn module(device: &wgpu::Device, label: &str, source: &str) -> wgpu::ShaderModule {
    let source = wgpu::ShaderSource::Wgsl(source.into());
    device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(label), source })
}

/// The layout of a pipeline with these groups.
pub(super) fn pipeline_layout(device: &wgpu::Device, label: &str, groups: &[&wgpu::BindGroupLayout]) -> wgpu::PipelineLayout {
    let groups: Vec<_> = groups.iter().copied().map(Some).collect();
    device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(label),
        bind_group_layouts: &groups,
        immediate_size: 0,
    })
}

/// A compute pipeline, called after its entry point; `constants` of its module by name.
pub(super) fn compute(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    entry_point: &str,
    groups: &[&wgpu::BindGroupLayout],
    constants: &[(&str, f64)],
) -> wgpu::ComputePipeline {
    device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry_point),
        layout: Some(&pipeline_layout(device, entry_point, groups)),
        module,
        entry_point: Some(entry_point),
        compilation_options: wgpu::PipelineCompilationOptions { constants, ..Default::default() },
        cache: None,
    })
}
