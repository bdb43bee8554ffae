pub(crate) mod normal_differential;
pub(crate) mod triangle_data;
