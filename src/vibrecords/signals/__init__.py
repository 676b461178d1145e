"""From time records to FRFs."""
