pub(crate) mod children;
