"""What tables in columns unpack to, told by their own headers before a byte is unpacked."""
