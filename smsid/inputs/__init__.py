"""What drives a spacecraft: signals over time, and the inputs made of them; `smsid.simulate` offers them."""

__all__: tuple[str, ...] = ()
